"""The paper's Fig. 4 on our data: the fragments that every method reached.

Fragments are laid side by side in their canonical frames, so that they can be compared wherever they ended up: the
goal's by size, and the results in the order of the goal fragments that they are matched with, turned like these.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from cutgrammar.geometry.canonical import FLIPS, canonical_frame
from cutgrammar.geometry.fragment import Cloud, Configuration, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import cloud_of
from cutgrammar_dashboards.figures.layout.sheet import MARGIN, PORTRAIT, QUIET_INK, Sheet, new_sheet, portrait, rgb
from cutgrammar_dashboards.figures.layout.spread import bodies_apart, fitting_scale, laid_out
from cutgrammar_dashboards.rendering.body import Body
from cutgrammar_dashboards.rendering.drawing import FRONT
from cutgrammar_dashboards.rendering.palette import GOAL, UNCUT, UNMATCHED, soft_graded

WIDTH, HEIGHT, GAP, HEAD, SIDE = 1.75, 1.62, 0.10, 1.20, 1.05
"""Size of a tile, the gap between tiles, height of the heading, width of the text before a row [inches]."""
FRAGMENT_GAP = 0.05
"""Gap between fragments laid side by side [inches]."""


@dataclass(frozen=True, eq=False)
class MethodResult:
    """The result of one method in a trial.

    Attributes:
        method: its name.
        fragments: the configuration reached.
        pairs: (reached, goal, IoU) of matched fragments.
        iou_strict: sum of the IoU, divided by the larger number of fragments.
        status: how the trial ended, e.g. "done".
    """

    method: str
    fragments: Configuration
    pairs: tuple[tuple[int, int, float], ...]
    iou_strict: float
    status: str

    def flip(self, i: int, model: Mesh | Cloud) -> Pose:
        """The one of `FLIPS` of the canonical frame that makes reached fragment `i` most similar to `model`."""
        shapes = self.fragments[i].shape, model
        points, wanted = (canonical_frame(shape).inverse().apply(cloud_of(shape, 160).points) for shape in shapes)
        tree = cKDTree(wanted)
        distances = [round(float(tree.query(flip.apply(points))[0].mean()), 9) for flip in FLIPS]
        return FLIPS[int(np.argmin(distances))]


@dataclass(frozen=True, eq=False)
class TrialResults:
    """One trial and its results under several methods.

    Attributes:
        title, subtitle: its heading.
        start, goal: its configurations.
        results: one for each method.
    """

    title: str
    subtitle: str
    start: Configuration
    goal: Configuration
    results: tuple[MethodResult, ...]


def draw_methods(trials: Sequence[TrialResults], title: str) -> Figure:
    """All methods side by side, a row for each trial (Fig. 4).

    Args:
        trials: from top to bottom.
        title: heading of the sheet.
    """
    methods = list(dict.fromkeys(result.method for trial in trials for result in trial.results))
    width = 2.0 * MARGIN + SIDE + (len(methods) + 2) * (WIDTH + GAP) - GAP
    height = HEAD + len(trials) * (HEIGHT + GAP) - GAP + MARGIN
    subtitle = "Fragments side by side, in the order of the goal fragments they are matched with; below: strict IoU."
    with new_sheet(width, height, title, subtitle) as sheet:
        _draw_legend(sheet, width - MARGIN, 0.40)
        for k, name in enumerate(("start", "goal", *methods)):
            sheet.write(_left(k) + WIDTH / 2.0, HEAD - 0.16, name, fontsize=10, fontweight="bold", ha="center")
        for j, trial in enumerate(trials):
            _draw_row(sheet, trial, methods, HEAD + j * (HEIGHT + GAP))
    return sheet.figure


def unused(count: int, used: Sequence[int]) -> list[int]:
    """The indices below `count` that are not among `used`."""
    return [i for i in range(count) if i not in set(used)]


def _left(column: int) -> float:
    return MARGIN + SIDE + column * (WIDTH + GAP)


def _draw_row(sheet: Sheet, trial: TrialResults, methods: Sequence[str], y: float) -> None:
    middle, caption = y + HEIGHT / 2.0, y + HEIGHT - 0.14
    sheet.write(MARGIN, middle - 0.10, trial.title, fontsize=11, fontweight="bold")
    sheet.write(MARGIN, middle + 0.12, trial.subtitle, fontsize=7, color=QUIET_INK)
    order = sorted(range(len(trial.goal)), key=lambda j: (-trial.goal[j].shape.volume, j))
    results = {result.method: result for result in trial.results}
    shown = {"goal": [portrait(trial.goal[j].shape, GOAL) for j in order]}
    shown |= {method: _in_order(trial, result, order) for method, result in results.items()}
    scale = fitting_scale(list(shown.values()), PORTRAIT, WIDTH - 0.16, HEIGHT - 0.40, FRAGMENT_GAP)
    sheet.tile(_left(0), y, WIDTH, HEIGHT)
    start = bodies_apart(trial.start, [UNCUT] * len(trial.start), 0.0)
    sheet.place_fitted(start, FRONT, (_left(0) + WIDTH / 2.0, middle), 0.84 * WIDTH, 0.74 * HEIGHT)
    for k, name in enumerate(("goal", *methods), start=1):
        x = _left(k)
        if name not in shown:
            sheet.write(x + WIDTH / 2.0, middle, "–", ha="center", color=QUIET_INK)
            continue
        sheet.tile(x, y, WIDTH, HEIGHT)
        row = laid_out(shown[name], PORTRAIT, (WIDTH - 0.16) / scale, FRAGMENT_GAP / scale)
        sheet.place(row, PORTRAIT, (x + WIDTH / 2.0, y + (HEIGHT - 0.26) / 2.0), scale)
        result = results.get(name)
        if result is None:
            sheet.write(x + WIDTH / 2.0, caption, f"{len(order)} fragments", ha="center", fontsize=7.5)
        else:
            sheet.write(x + 0.10, caption, f"{result.iou_strict:.2f}", fontsize=9.5, fontweight="bold")
            ending = "" if result.status == "done" else f", {result.status}"
            text = f"{len(result.fragments)} of {len(order)}{ending}"
            sheet.write(x + WIDTH - 0.10, caption, text, fontsize=7, ha="right", color=QUIET_INK)


def _in_order(trial: TrialResults, result: MethodResult, order: Sequence[int]) -> list[Body]:
    """The results in the order of the goal fragments they are matched with; the others follow by size."""
    partner = {j: (i, iou) for i, j, iou in result.pairs}
    bodies = []
    for j in order:
        if j in partner:
            i, iou = partner[j]
            bodies.append(portrait(result.fragments[i].shape, soft_graded(iou), result.flip(i, trial.goal[j].shape)))
    rest = unused(len(result.fragments), [i for i, *_ in result.pairs])
    rest.sort(key=lambda i: -result.fragments[i].shape.volume)
    return bodies + [portrait(result.fragments[i].shape, UNMATCHED) for i in rest]


def _draw_legend(sheet: Sheet, right: float, y: float) -> None:
    """Draw the scale of colours and the colour of unmatched fragments."""
    left, steps, style = right - 2.3, 24, {"linewidth": 8, "solid_capstyle": "butt"}
    for i in range(steps):
        ends = [(left + 1.2 * (i + share) / steps, y) for share in (0, 1)]
        sheet.line(ends, color=rgb(soft_graded((i + 0.5) / steps)), **style)
    sheet.write(left - 0.08, y, "IoU of a pair  0", ha="right")
    sheet.write(left + 1.26, y, "1")
    sheet.line([(left + 1.52, y), (left + 1.66, y)], color=rgb(UNMATCHED), **style)
    sheet.write(left + 1.74, y, "unmatched")
