"""The layouts of the viewer for an evaluation and for a training."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun.blueprint as rrb

from cutgrammar.trials.news import RunBegan
from cutgrammar_dashboards.live.live_writer import ELAPSED
from cutgrammar_dashboards.live.scoreboard import MEANS, SAVED, TABLE
from cutgrammar_dashboards.live.worlds import HEADLINE, MAX_SHOWN, place_of
from cutgrammar_dashboards.recording import blueprint
from cutgrammar_dashboards.recording.blueprint import eye_on, space

LARGE = 4
"""Up to so many workers, each shows its world, goal, parse tree and search at once; more workers show them as tabs."""

BOARD = np.array([[-0.08, -0.08, 0.0], [0.08, 0.08, 0.0]])
"""Lowest and highest corner of where most fragments lie [m]; a layout knows no trial yet."""


def evaluation_layout(run: RunBegan) -> Any:
    """A cell for each worker, beside the scores."""
    count = min(run.workers, MAX_SHOWN)
    cells = [_cell(slot, run, large=count <= LARGE) for slot in range(count)]
    grid = cells[0] if count == 1 else rrb.Grid(*cells, grid_columns=1 if count == 2 else 2 if count <= LARGE else 3)
    logs = ["/" + SAVED, *(f"/{place_of(slot)}/{blueprint.LOG}" for slot in range(count))]
    beside = rrb.Vertical(
        rrb.TextDocumentView(name="Scores so far", origin=f"/{TABLE}"),
        rrb.TimeSeriesView(name="Mean strict IoU so far", origin=f"/{MEANS}"),
        rrb.TextLogView(
            name="What happens",
            origin="/",
            contents=logs,
            columns=rrb.TextLogColumns(timeline_columns=[ELAPSED], text_log_columns=["EntityPath", "Body"]),
        ),
        row_shares=[3, 3, 4],
    )
    return _framed(rrb.Horizontal(grid, beside, column_shares=[5, 2]), ELAPSED)


def training_layout(stages: Sequence[str]) -> Any:
    """A view for each stage that has a curve, beside how far the training is."""
    views = [rrb.TimeSeriesView(name=_curve_name(stage), origin=f"/curves/{stage}") for stage in stages]
    how_far = rrb.TextDocumentView(name="Training", origin="/progress")
    if not views:
        return _framed(how_far, STEP)
    return _framed(rrb.Horizontal(rrb.Grid(*views), how_far, column_shares=[4, 1]), STEP)


STEP = "epoch or k"
"""The timeline of a training's curves."""


def _curve_name(stage: str) -> str:
    if stage == "induction":
        return "Induction: objective over the number of types k"
    return f"{stage.replace('_', ' ')}: loss over epochs"


def _cell(slot: int, run: RunBegan, large: bool) -> Any:
    """The views of one worker."""
    place, name = place_of(slot), f"Worker {slot + 1}"

    def of(title: str, *paths: str, origin: str = "") -> Any:
        whole = f"{place}/{origin}" if origin else place
        return space(title, *(f"{place}/{path}" for path in paths), origin=whole, eye=eye_on(BOARD))

    worlds = [of(f"{name}: fragments", blueprint.NOW, blueprint.CUT)]
    if run.arm:
        worlds.insert(1, of("Arm", blueprint.ARM, blueprint.BLADE, blueprint.NOW, blueprint.CUT))
    if run.cameras:
        worlds += [of("Seen", blueprint.SEEN), of("Segmented", blueprint.SEGMENTED)]
    goal = of("Goal", blueprint.GOAL, origin=blueprint.GOAL)
    tree = rrb.GraphView(name="Parse tree", origin=f"/{place}/{blueprint.TREE}")
    search = rrb.TimeSeriesView(name="Best score of the search", origin=f"/{place}/{blueprint.SEARCH}")
    headline = rrb.TextDocumentView(name=name, origin=f"/{place}/{HEADLINE}")
    if large:
        above = rrb.Horizontal(rrb.Tabs(*worlds, active_tab=0), goal, column_shares=[3, 2])
        below = rrb.Horizontal(tree, search, column_shares=[3, 2])
        return rrb.Vertical(headline, above, below, row_shares=[3, 8, 6], name=name)
    return rrb.Vertical(headline, rrb.Tabs(*worlds, goal, tree, search, active_tab=0), row_shares=[3, 8], name=name)


def _framed(content: Any, timeline: str) -> Any:
    return rrb.Blueprint(
        content,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=timeline, play_state="following"),
        auto_layout=False,
        auto_views=False,
    )
