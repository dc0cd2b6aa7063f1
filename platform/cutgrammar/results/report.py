"""A report as data: sections of tables and figures, computed once and rendered as text, page or JSON.

Renderers only lay it out. A cell holds its value and its format, so that a number reads the same everywhere.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from cutgrammar.geometry.fragment import Configuration

UNKNOWN = "–"
"""Printed for a value that is not known."""

Interval = tuple[float, float]

RowKind = Literal["", "total", "apart", "bad"]
"""An ordinary row; one that sums up those above; the first of a group set apart by a line; one that warns."""


@dataclass(frozen=True)
class Cell:
    """One value of a table.

    Attributes:
        value: a word, a number, an interval, or None where it is not known.
        format: Python's format of the number or of both ends of the interval, or "p" for a p-value.
        spread: standard deviation, printed with the value.
        interval: ends of the 95 % interval; pages print it below the value, plain text in some tables.
        is_code: the value is a command or a digest.
        link: file that the value leads to.
    """

    value: str | float | Interval | None
    format: str = ""
    spread: float | None = None
    interval: Interval | None = None
    is_code: bool = False
    link: Path | None = None

    @property
    def text(self) -> str:
        """The value as it is printed, with its spread."""
        printed = format_value(self.value, self.format)
        return printed if self.spread is None else f"{printed} ± {format_value(self.spread, self.format)}"


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes:
        heading: of the column.
        group: heading over neighbouring columns with the same group.
        holds_words: words are aligned to the left, numbers to the right.
        is_key: the column names the rows, and is repeated where a table is split.
    """

    heading: str
    group: str = ""
    holds_words: bool = False
    is_key: bool = False


@dataclass(frozen=True)
class Row:
    """One row of a table."""

    cells: tuple[Cell, ...]
    kind: RowKind = ""


@dataclass(frozen=True)
class Table:
    """A titled table.

    Attributes:
        title: what it shows.
        columns, rows: of the table.
        note: what a reader must know of it.
        fold: heading under which a page folds the table away, and without which plain text leaves it out; "" for none.
        tells_intervals: plain text prints intervals below their values, too.
    """

    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    note: str = ""
    fold: str = ""
    tells_intervals: bool = False


@dataclass(frozen=True)
class Dot:
    """A value and its interval on one line of a chart, in the colour of its series."""

    line: str
    series: str
    value: float
    interval: Interval | None


@dataclass(frozen=True)
class Panel:
    """Dots on shared lines; `reference` is the position of an upright line."""

    title: str
    dots: tuple[Dot, ...]
    reference: float | None


@dataclass(frozen=True)
class DotChart:
    """Panels side by side that share their lines.

    Attributes:
        title: description for readers who cannot see the chart.
        caption: below the chart.
        lines: from the top.
        panels: from the left.
        x_label: of the axis.
        x_range: of the axis; None to fit the dots.
        groups: number of each line's group; a rule parts neighbouring groups.
        has_legend: the series are named above the chart, since they are not the lines.
        is_narrow: it is drawn beside another figure.
    """

    title: str
    caption: str
    lines: tuple[str, ...]
    panels: tuple[Panel, ...]
    x_label: str = ""
    x_range: Interval | None = (0.0, 1.0)
    groups: tuple[int, ...] = ()
    has_legend: bool = False
    is_narrow: bool = False


@dataclass(frozen=True)
class Line:
    """One line of a chart with its band; `x`, `y` and both ends of the band have the same length."""

    series: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    band: tuple[tuple[float, ...], tuple[float, ...]] | None


@dataclass(frozen=True)
class LineChart:
    """Lines over a common axis."""

    title: str
    caption: str
    lines: tuple[Line, ...]
    x_label: str
    y_label: str


@dataclass(frozen=True)
class StripChart:
    """Single values, one row of dots a line, coloured by group, with the mean of each line.

    Attributes:
        title, caption, x_label: words.
        values: line -> group -> values.
        fold: heading under which a page folds it away.
    """

    title: str
    caption: str
    x_label: str
    values: Mapping[str, Mapping[str, tuple[float, ...]]]
    fold: str = ""


@dataclass(frozen=True, eq=False)
class TrialResult:
    """What one trial reached.

    Attributes:
        title: above the fragments, e.g. the name of the run.
        text: its score and how it ended.
        fragments: the configuration reached.
        pairs: ((reached, goal, IoU), ...) of the matching that the scores are computed from.
        command: that shows the trial step by step.
        recording: of the trial, if there is one.
    """

    title: str
    text: str
    fragments: Configuration
    pairs: tuple[tuple[int, int, float], ...]
    command: str = ""
    recording: Path | None = None


@dataclass(frozen=True, eq=False)
class TrialPicture:
    """A trial to be drawn, and turned by the reader of a page: its start, its goal, and one result or several.

    Attributes:
        caption: its name and why it is shown.
        start, goal: its configurations.
        results: of one run, or of several side by side.
        fold: heading under which a page folds it away.
    """

    caption: str
    start: Configuration
    goal: Configuration
    results: tuple[TrialResult, ...]
    fold: str = ""


Figure = DotChart | LineChart | StripChart | TrialPicture
"""Data that a page draws and plain text leaves out."""

Item = Table | Figure | tuple[Figure, ...]
"""An item of a section; figures in a tuple are drawn side by side."""


@dataclass(frozen=True)
class Section:
    """A part of a report.

    Attributes:
        title, subtitle: its heading.
        items: in reading order.
        lead: a sentence below the heading.
        is_detail: plain text leaves the section out.
    """

    title: str
    items: tuple[Item, ...]
    subtitle: str = ""
    lead: str = ""
    is_detail: bool = False


@dataclass(frozen=True)
class Report:
    """The content of a report.

    Attributes:
        title, lead: heading and first sentences.
        numbers: the numbers of the tables, as JSON data with documented names.
        sections: tables and figures, in reading order.
        glossary: (term, explanation), ...
        notes: reservations about the numbers, e.g. missing trials.
        digest: of all results except times; "" if there is none.
        series: names that have a colour of their own in charts.
        dashed: the series whose lines are dashed.
    """

    title: str
    lead: str
    numbers: Mapping[str, Any]
    sections: tuple[Section, ...]
    glossary: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()
    digest: str = ""
    series: tuple[str, ...] = ()
    dashed: frozenset[str] = field(default_factory=frozenset)

    def to_json(self) -> dict[str, Any]:
        """The numbers and the notes, if there are any."""
        return dict(self.numbers) | ({"notes": list(self.notes)} if self.notes else {})


def format_value(value: str | float | Interval | None, form: str) -> str:
    """A value as it is printed.

    Example:
        >>> format_value((0.0213, 0.4), "+.3f"), format_value(0.0002, "p")
        ('+0.021 to +0.400', '< 0.001')
    """
    if value is None:
        return UNKNOWN
    if isinstance(value, str):
        return value
    if isinstance(value, tuple):
        return " to ".join(format_value(end, form) for end in value)
    if form == "p":
        return "< 0.001" if value < 0.001 else f"{value:.3f}"
    return f"{value:{form}}"


def as_interval(ends: Sequence[float] | None) -> Interval | None:
    """Two ends from JSON data."""
    return None if ends is None else (ends[0], ends[1])


def keys(*headings: str) -> tuple[Column, ...]:
    """Columns that name the rows."""
    return tuple(Column(heading, holds_words=True, is_key=True) for heading in headings)


def columns(*headings: str) -> tuple[Column, ...]:
    """Columns of numbers."""
    return tuple(Column(heading) for heading in headings)


def words(*headings: str) -> tuple[Column, ...]:
    """Columns of words."""
    return tuple(Column(heading, holds_words=True) for heading in headings)
