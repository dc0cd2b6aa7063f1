"""A report as one HTML page that loads nothing from the network: Jinja2 lays out its tables, matplotlib its figures."""

import os
from itertools import count, groupby
from pathlib import Path

import jinja2

from cutgrammar.atomic_files import write_atomic
from cutgrammar.results.report import Figure, LineChart, Report, StripChart, Table, TrialPicture, format_value
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
    numbers = count()
    return TEMPLATES.get_template("report.html").render(
        report=report,
        draw=lambda figure: _draw(figure, colours, report.dashed, f"figure{next(numbers)}"),
        is_table=lambda item: isinstance(item, Table),
        is_pair=lambda item: isinstance(item, tuple),
        folds=lambda items: [
            (fold, list(group)) for fold, group in groupby(items, lambda item: getattr(item, "fold", ""))
        ],
        spans=lambda columns: [(name, len(list(group))) for name, group in groupby(column.group for column in columns)],
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
