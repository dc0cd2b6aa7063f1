"""The paper's Fig. 4 and Fig. 5 on our data: what every method reached, and how fragments were matched.

Fragments lie side by side in their canonical frames, so that they can be compared wherever they ended up: the goal's by
size, and what was reached in the order of the goal fragments it is matched with, turned as these are.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from scipy.spatial import cKDTree

from cutgrammar.geometry.canonical import FLIPS, canonical_frame
from cutgrammar.geometry.fragment import Cloud, Configuration, Mesh
from cutgrammar.geometry.sampling import cloud_of
from cutgrammar_dashboards.figures.layout.sheet import (
    FAINT,
    PORTRAIT,
    QUIET_INK,
    STYLE,
    line,
    portrait,
    put,
    scale_to_fit,
    seen_size,
    sheet,
    words,
)
from cutgrammar_dashboards.figures.layout.spread import fitting_scale, laid_out
from cutgrammar_dashboards.rendering.body import Body, body_of_fragment
from cutgrammar_dashboards.rendering.drawing import FRONT
from cutgrammar_dashboards.rendering.palette import Colour, graded

WIDE, HIGH, GAP, MARGIN, HEAD, SIDE = 1.75, 1.62, 0.10, 0.35, 1.20, 1.05
"""Size of a tile, the gap between tiles, the page's margin and heading, the words before a row [inches]."""
APART = 0.05
"""Gap between fragments laid side by side [inches]."""
GOAL: Colour = (120, 168, 214)
RAW: Colour = (214, 190, 150)
UNMATCHED: Colour = (176, 180, 186)


@dataclass(frozen=True, eq=False)
class Reached:
    """What a method reached.

    Attributes:
        method: its name.
        fragments: what was reached.
        pairs: (reached, goal, IoU) of matched fragments.
        iou_strict: their sum over the larger count.
        status: how the trial ended, e.g. "done".
    """

    method: str
    fragments: Configuration
    pairs: tuple[tuple[int, int, float], ...]
    iou_strict: float
    status: str


@dataclass(frozen=True, eq=False)
class Contest:
    """One trial and what every method reached in it.

    Attributes:
        title, subtitle: what it is called.
        start, goal: its configurations.
        results: one a method.
    """

    title: str
    subtitle: str
    start: Configuration
    goal: Configuration
    results: tuple[Reached, ...]


def draw_methods(contests: Sequence[Contest], title: str) -> Figure:
    """All methods side by side, a row for each trial (Fig. 4).

    Args:
        contests: from top to bottom.
        title: the sheet's heading.
    """
    methods = list(dict.fromkeys(result.method for contest in contests for result in contest.results))
    width = 2.0 * MARGIN + SIDE + (len(methods) + 2) * (WIDE + GAP) - GAP
    with matplotlib.rc_context(STYLE):
        figure, ax = sheet(width, HEAD + len(contests) * (HIGH + GAP) + MARGIN - GAP)
        words(ax, MARGIN, 0.36, title, fontsize=13, fontweight="bold")
        told = (
            "Fragments by themselves, in the order of the goal's that they are matched with; under them the strict IoU."
        )
        words(ax, MARGIN, 0.62, told, color=QUIET_INK)
        _scale_bar(ax, width - MARGIN, 0.40)
        for k, name in enumerate(("start", "goal", *methods)):
            x = MARGIN + SIDE + k * (WIDE + GAP) + WIDE / 2.0
            words(ax, x, HEAD - 0.16, name, fontsize=10, fontweight="bold", ha="center")
        for j, contest in enumerate(contests):
            _row(ax, contest, methods, HEAD + j * (HIGH + GAP))
    return figure


def draw_matching(contest: Contest, title: str, a_row: int) -> Figure:
    """The matched pairs of the first result of a trial, and what is matched with nothing (Fig. 5).

    Args:
        contest: the trial.
        title: the sheet's heading.
        a_row: most pairs in a row.
    """
    result = contest.results[0]
    pairs = sorted(result.pairs, key=lambda pair: -pair[2])
    matched = {i: FLIPS[_flip(result.fragments[i].shape, contest.goal[j].shape)] for i, j, _ in pairs}
    columns: list[tuple[int | None, int | None, float | None]] = [*pairs]
    columns += [(None, j, None) for j in _left(len(contest.goal), [j for _, j, _ in pairs])]
    columns += [(i, None, None) for i in _left(len(result.fragments), [i for i, *_ in pairs])]
    goals = {j: portrait(fragment.shape, UNMATCHED) for j, fragment in enumerate(contest.goal)}
    reached = {i: portrait(f.shape, UNMATCHED, matched.get(i)) for i, f in enumerate(result.fragments)}
    for a, b, share in pairs:
        goals[b], reached[a] = (body.coloured(graded_soft(share)) for body in (goals[b], reached[a]))
    everything = [*goals.values(), *reached.values()]
    cell, scale = 1.15, min(scale_to_fit([body], PORTRAIT, 1.05, 0.9) for body in everything)
    high = scale * max(seen_size([body], PORTRAIT)[1] for body in everything)
    band = 2.0 * high + 1.05
    rows = -(-len(columns) // a_row)
    a_row = -(-len(columns) // rows)  # rows alike
    with matplotlib.rc_context(STYLE):
        figure, ax = sheet(max(2.0 * MARGIN + 0.75 + a_row * cell, 7.2), 0.95 + rows * band)
        words(ax, MARGIN, 0.36, title, fontsize=13, fontweight="bold")
        told = (
            f"{len(pairs)} matched pairs, best first; {len(contest.goal)} fragments in the goal, {len(reached)} reached"
        )
        words(
            ax,
            MARGIN,
            0.62,
            f"{told}; strict IoU {result.iou_strict:.3f}. Grey: matched with nothing.",
            color=QUIET_INK,
        )
        for n, (i, j, iou) in enumerate(columns):
            x, y = MARGIN + 0.75 + (n % a_row + 0.5) * cell, 0.95 + band * (n // a_row)
            above, below = y + high / 2.0, y + 1.5 * high + 0.62
            if n % a_row == 0:
                words(ax, MARGIN, above, "goal", fontweight="bold")
                words(ax, MARGIN, below, "reached", fontweight="bold")
            if j is not None:
                put(ax, [goals[j]], PORTRAIT, (x, above), scale)
            if i is not None:
                put(ax, [reached[i]], PORTRAIT, (x, below), scale)
            if iou is not None:
                between = (above + below) / 2.0
                words(ax, x, between, f"{iou:.2f}", ha="center", fontsize=9)
                for top, bottom in ((y + high + 0.06, between - 0.10), (between + 0.10, y + high + 0.56)):
                    line(ax, [(x, top), (x, bottom)], linestyle=(0, (1.5, 2.2)), linewidth=1.3)
    return figure


def graded_soft(iou: float) -> Colour:
    """The colour of an IoU, softened for large surfaces, and spread so that middling ones can be told apart."""
    r, g, b = (round(0.78 * part + 0.22 * 225) for part in graded(iou**1.6))
    return r, g, b


def _row(ax: Axes, contest: Contest, methods: Sequence[str], y: float) -> None:
    words(ax, MARGIN, y + HIGH / 2.0 - 0.10, contest.title, fontsize=11, fontweight="bold")
    words(ax, MARGIN, y + HIGH / 2.0 + 0.12, contest.subtitle, fontsize=7, color=QUIET_INK)
    order = sorted(range(len(contest.goal)), key=lambda j: (-contest.goal[j].shape.volume, j))
    goal = [portrait(contest.goal[j].shape, GOAL) for j in order]
    trays = {result.method: _in_order(contest, result, order) for result in contest.results}
    scale = fitting_scale([goal, *trays.values()], PORTRAIT, WIDE - 0.16, HIGH - 0.40, APART)
    start = [body_of_fragment(fragment, RAW) for fragment in contest.start]
    x = MARGIN + SIDE
    _tile(ax, x, y)
    put(ax, start, FRONT, (x + WIDE / 2.0, y + HIGH / 2.0), scale_to_fit(start, FRONT, 0.84 * WIDE, 0.74 * HIGH))
    for k, name in enumerate(("goal", *methods), start=1):
        x = MARGIN + SIDE + k * (WIDE + GAP)
        result = next((one for one in contest.results if one.method == name), None)
        if name != "goal" and result is None:
            words(ax, x + WIDE / 2.0, y + HIGH / 2.0, "–", ha="center", color=QUIET_INK)
            continue
        _tile(ax, x, y)
        bodies = goal if result is None else trays[name]
        tray = laid_out(bodies, PORTRAIT, (WIDE - 0.16) / scale, APART / scale)
        put(ax, tray.bodies, PORTRAIT, (x + WIDE / 2.0, y + (HIGH - 0.26) / 2.0), scale)
        if result is None:
            words(ax, x + WIDE / 2.0, y + HIGH - 0.14, f"{len(goal)} fragments", ha="center", fontsize=7.5)
        else:
            words(ax, x + 0.10, y + HIGH - 0.14, f"{result.iou_strict:.2f}", fontsize=9.5, fontweight="bold")
            ended = "" if result.status == "done" else f", {result.status}"
            told = f"{len(result.fragments)} of {len(goal)}{ended}"
            words(ax, x + WIDE - 0.10, y + HIGH - 0.14, told, fontsize=7, ha="right", color=QUIET_INK)


def _in_order(contest: Contest, result: Reached, order: Sequence[int]) -> list[Body]:
    """What was reached, in the order of the goal fragments it is matched with; the rest behind, by size."""
    partner = {j: (i, iou) for i, j, iou in result.pairs}
    bodies = []
    for j in order:
        if j in partner:
            i, iou = partner[j]
            flip = FLIPS[_flip(result.fragments[i].shape, contest.goal[j].shape)]
            bodies.append(portrait(result.fragments[i].shape, graded_soft(iou), flip))
    left = _left(len(result.fragments), [i for i, *_ in result.pairs])
    left.sort(key=lambda i: -result.fragments[i].shape.volume)
    return bodies + [portrait(result.fragments[i].shape, UNMATCHED) for i in left]


def _flip(shape: Mesh | Cloud, model: Mesh | Cloud) -> int:
    """Which of `FLIPS` of the canonical frame makes `shape` most like `model`: nearest surface points decide."""
    points, wanted = (canonical_frame(one).inverse().apply(cloud_of(one, 160).points) for one in (shape, model))
    tree = cKDTree(wanted)
    return int(np.argmin([round(float(tree.query(flip.apply(points))[0].mean()), 9) for flip in FLIPS]))


def _left(count: int, used: Sequence[int]) -> list[int]:
    return [i for i in range(count) if i not in set(used)]


def _tile(ax: Axes, x: float, y: float) -> None:
    frame = FancyBboxPatch((x, y), WIDE, HIGH, boxstyle="round,pad=0,rounding_size=0.06", linewidth=0.8)
    frame.set(facecolor="#fafbfc", edgecolor=FAINT)
    ax.add_patch(frame)


def _scale_bar(ax: Axes, right: float, y: float) -> None:
    """What the colours mean."""
    left, steps = right - 2.3, 24
    for i in range(steps):
        shade = tuple(part / 255.0 for part in graded_soft((i + 0.5) / steps))
        line(
            ax,
            [(left + 1.2 * i / steps, y), (left + 1.2 * (i + 1) / steps, y)],
            color=shade,
            linewidth=8,
            solid_capstyle="butt",
        )
    words(ax, left - 0.08, y, "IoU of a pair  0", ha="right")
    words(ax, left + 1.26, y, "1")
    line(
        ax,
        [(left + 1.52, y), (left + 1.66, y)],
        color=tuple(part / 255.0 for part in UNMATCHED),
        linewidth=8,
        solid_capstyle="butt",
    )
    words(ax, left + 1.74, y, "unmatched")
