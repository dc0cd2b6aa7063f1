"""A report as one HTML page that loads nothing from the network: Jinja2 lays out its tables, matplotlib its figures."""

import os
from collections.abc import Callable
from itertools import count, groupby
from pathlib import Path
from urllib.parse import quote

import jinja2

from cutgrammar.atomic_files import write_atomic
from cutgrammar.results.report import (
    DotChart,
    LineChart,
    Report,
    StripChart,
    Table,
    TrialPicture,
    format_value,
)
from cutgrammar.results.score_table import ignore
from cutgrammar_dashboards.pages.one_file import one_script, source_of
from cutgrammar_dashboards.pages.static_files import static_files
from cutgrammar_dashboards.rendering.palette import Colour
from cutgrammar_dashboards.report.charts import colours_of, draw_dots, draw_lines, draw_strips
from cutgrammar_dashboards.report.trial import DrawnTrial, TrialDrawer

TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("cutgrammar_dashboards.report"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)

TEMPLATES.tests["is_trial"] = lambda item: isinstance(item, TrialPicture)
SCRIPTS = ("three.js", "scene.js", "turn.js")
"""The modules of a page with trials, in the order in which they depend on one another."""


def write_page(report: Report, out: Path, watch: Callable[[int, int], object] = ignore) -> None:
    """Write the page to `out`; an older file is replaced when the new one is complete. For `watch` see `page`."""
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(out, page(report, out.parent, watch).encode())


def page(report: Report, folder: Path, watch: Callable[[int, int], object] = ignore) -> str:
    """The page as text; all values are escaped.

    Args:
        report: what to show.
        folder: where the page will be; links are relative to it.
        watch: called with the number of trials drawn and their total.
    """
    colours = colours_of(report.series, report.dashed)
    numbers, drawn = count(), count(1)
    n_trials = sum(isinstance(item, TrialPicture) for section in report.sections for item in section.items)
    drawer = TrialDrawer()

    def draw_trial(trial: TrialPicture) -> DrawnTrial:
        found = drawer.draw(trial)
        watch(next(drawn), n_trials)
        return found

    return TEMPLATES.get_template("report.html").render(
        report=report,
        draw=lambda figure: _draw(figure, colours, report.dashed, f"figure{next(numbers)}"),
        draw_trial=draw_trial,
        script=one_script(static_files(("pages", "report")), SCRIPTS) if n_trials else "",
        source_of=source_of,
        is_trial=lambda item: isinstance(item, TrialPicture),
        is_table=lambda item: isinstance(item, Table),
        is_pair=lambda item: isinstance(item, tuple),
        folds=lambda items: [
            (fold, list(group)) for fold, group in groupby(items, lambda item: getattr(item, "fold", ""))
        ],
        spans=lambda columns: [(name, len(list(group))) for name, group in groupby(column.group for column in columns)],
        interval=lambda cell: format_value(cell.interval, cell.format),
        address=lambda link: quote(Path(os.path.relpath(link, folder)).as_posix()),
    )


def _draw(
    figure: DotChart | LineChart | StripChart, colours: dict[str, Colour], dashed: frozenset[str], salt: str
) -> str:
    """The figure as SVG."""
    if isinstance(figure, LineChart):
        return draw_lines(figure, colours, dashed, salt)
    if isinstance(figure, StripChart):
        return draw_strips(figure, salt)
    return draw_dots(figure, colours, salt)
