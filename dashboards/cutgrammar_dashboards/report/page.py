"""A report as one HTML page that loads nothing from the network: Jinja2 lays out its tables, matplotlib its figures."""

import os
from pathlib import Path

import jinja2

from cutgrammar.atomic_files import write_atomic
from cutgrammar.results.report import Column, Figure, LineChart, Report, StripChart, Table, TrialPicture, format_value
from cutgrammar_dashboards.figures.trial_picture import trial_picture
from cutgrammar_dashboards.rendering.palette import Colour
from cutgrammar_dashboards.report.charts import colours_of, draw_dots, draw_lines, draw_strips

TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("cutgrammar_dashboards.report"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def write_page(report: Report, out: Path) -> None:
    """Write the page to `out`; an older file is replaced when the new one is complete."""
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(out, page(report, out.parent).encode())


def page(report: Report, folder: Path) -> str:
    """The page as text; all values are escaped.

    Args:
        report: what to show.
        folder: where the page will be; links are relative to it.
    """
    colours = colours_of(report.series, report.dashed)
    numbered = iter(range(10**6))

    def draw(figure: Figure) -> str:
        return _draw(figure, colours, report.dashed, f"figure{next(numbered)}")

    return TEMPLATES.get_template("report.html").render(
        report=report,
        anchors={section.title + section.subtitle: f"part{i}" for i, section in enumerate(report.sections)},
        draw=draw,
        is_table=lambda item: isinstance(item, Table),
        is_pair=lambda item: isinstance(item, tuple),
        blocks=_blocks,
        spans=_spans,
        interval=lambda cell: format_value(cell.interval, cell.format),
        address=lambda link: Path(os.path.relpath(link, folder)).as_posix(),
    )


def _draw(figure: Figure, colours: dict[str, Colour], dashed: frozenset[str], salt: str) -> str:
    """The figure as SVG or as an image element."""
    if isinstance(figure, TrialPicture):
        shown = figure.configurations
        return trial_picture(shown.start, shown.goal, shown.reached, figure.pairs)
    if isinstance(figure, LineChart):
        return draw_lines(figure, colours, dashed, salt)
    if isinstance(figure, StripChart):
        return draw_strips(figure, salt)
    return draw_dots(figure, colours, salt)


def _spans(columns: tuple[Column, ...], first: int) -> int:
    """How many columns from number `first` on have its group."""
    after = (i for i in range(first, len(columns)) if columns[i].group != columns[first].group)
    return next(after, len(columns)) - first


def _blocks(items: tuple[object, ...]) -> list[tuple[str, list[object]]]:
    """Neighbouring items with one fold, under its heading."""
    found: list[tuple[str, list[object]]] = []
    for item in items:
        fold = getattr(item, "fold", "")
        if found and found[-1][0] == fold:
            found[-1][1].append(item)
        else:
            found.append((fold, [item]))
    return found
