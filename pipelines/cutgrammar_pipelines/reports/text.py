"""A report as plain text: its tables by rich, notes and glossary as wrapped lines; figures and details are left out."""

import io
import textwrap
from collections.abc import Sequence
from itertools import groupby

import rich.table
from rich import box
from rich.console import Console
from rich.text import Text

from cutgrammar.results.report import Cell, Report, Section, Table, format_value

MIN_WIDTH = 40
PADDING = 2
"""Blanks between columns."""


def as_text(report: Report, width: int = 100) -> str:
    """The report as plain text for a terminal with `width` columns, at least `MIN_WIDTH`.

    A line is longer than that only where the keys of a table and one group of its columns do not fit.
    """
    width = max(width, MIN_WIDTH)
    parts = [_section(section, width) for section in report.sections if not section.is_detail]
    parts = parts or ["No trial has been evaluated yet."]
    parts.append(
        _wrapped([f"{term}: {meaning}" for term, meaning in report.glossary] if report.sections else [], width)
    )
    parts.append(_wrapped([f"NOTE {note}" for note in report.notes], width))
    parts.append(f"digest {report.digest[:16]} (of all but times)" if report.digest and report.sections else "")
    return "\n\n".join(part for part in parts if part)


def _section(section: Section, width: int) -> str:
    heading = section.title + (f", {section.subtitle}" if section.subtitle else "")
    tables = [item for item in section.items if isinstance(item, Table) and not item.fold]
    return "\n\n".join([_wrapped([heading, section.lead], width), *(_table(table, width) for table in tables)])


def _table(table: Table, width: int) -> str:
    """The table, split into blocks of columns that fit the width; each block repeats the keys."""
    cells = [[_printed(cell, table.tells_intervals) for cell in row.cells] for row in table.rows]
    columns = table.columns
    sizes = [
        max(
            len(line)
            for text in (column.heading, column.group, *(row[i] for row in cells))
            for line in text.split("\n")
        )
        for i, column in enumerate(columns)
    ]
    key = [i for i, column in enumerate(columns) if column.is_key]
    others = [i for i, column in enumerate(columns) if not column.is_key]
    blocks: list[list[int]] = [[]]
    for group in (list(neighbours) for _, neighbours in groupby(others, lambda i: columns[i].group or i)):
        if blocks[-1] and sum(sizes[i] + PADDING for i in (*key, *blocks[-1], *group)) - PADDING > width:
            blocks.append([])
        blocks[-1] += group
    parts = [_block(table, cells, [*key, *block], sizes) for block in blocks]
    return "\n\n".join(["\n".join([_wrapped([table.title], width), parts[0]]), *parts[1:]]) + (
        f"\n{_wrapped([table.note], width)}" if table.note else ""
    )


def _printed(cell: Cell, tells_intervals: bool) -> str:
    """The value and, on a line of its own, its interval."""
    if not tells_intervals or cell.interval is None:
        return cell.text
    return f"{cell.text}\n{format_value(cell.interval, cell.format)}"


def _block(table: Table, cells: Sequence[Sequence[str]], chosen: Sequence[int], sizes: Sequence[int]) -> str:
    drawn = rich.table.Table(box=box.SIMPLE_HEAD, show_edge=False, padding=0, pad_edge=False, collapse_padding=True)
    has_groups = any(table.columns[i].group for i in chosen)
    last = ""
    for i in chosen:
        column = table.columns[i]
        group = column.group if column.group != last else ""
        last = column.group
        heading = f"{group}\n{column.heading}" if has_groups else column.heading
        drawn.add_column(Text(heading), justify="left" if column.holds_words else "right", no_wrap=True)
    for row, line in zip(table.rows, cells, strict=True):
        if row.kind in ("total", "apart"):
            drawn.add_section()
        drawn.add_row(*(Text(line[i]) for i in chosen))
    buffer = io.StringIO()
    Console(file=buffer, width=sum(sizes[i] + PADDING for i in chosen) + PADDING, color_system=None).print(drawn)
    return "\n".join(line.rstrip() for line in buffer.getvalue().splitlines() if line.strip())


def _wrapped(lines: Sequence[str], width: int) -> str:
    return "\n".join(part for line in lines for part in textwrap.wrap(line, width))
