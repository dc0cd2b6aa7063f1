"""What a reader can turn of a trial: goal, results, and matched pairs laid over one another, seen from one place.

Coordinates are metres, with z upwards from the ground and the middle above the origin. Panels of one trial are scaled
to one size, so that they can be seen from one place: goal and results by one factor, the pairs of each by another.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import FLIPS
from cutgrammar.geometry.comparison.overlap import Solid
from cutgrammar.geometry.fragment import Configuration, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.results.report import TrialPicture, TrialResult
from cutgrammar_dashboards.figures.layout.sheet import LYING
from cutgrammar_dashboards.figures.layout.spread import apart
from cutgrammar_dashboards.figures.trial_picture import pair_colours
from cutgrammar_dashboards.pages.packed_meshes import pack
from cutgrammar_dashboards.rendering.palette import Colour

RADIUS = 0.1
"""Radius of the sphere that holds what a panel shows [m]."""
SPREAD = 1.0
"""How far fragments move apart at most, as a share of their distance from the middle."""
GAP = 0.15
"""Between pairs, as a share of the longest side of a fragment."""
ENOUGH = 1e-3
"""A flip whose IoU is below the recorded one by less than this is the metric's."""


@dataclass(frozen=True, eq=False)
class Shown:
    """One fragment in a panel.

    Attributes:
        mesh: number of its mesh.
        colour: of the solid; None for an outline.
        X_PF: its pose in the panel, before scaling.
        shift: (3,) how it moves when fragments are moved apart, before scaling.
        pair: number of the goal fragment that it is matched with; -1 for none.
    """

    mesh: int
    colour: Colour | None
    X_PF: Pose
    shift: Floats
    pair: int


@dataclass(frozen=True, eq=False)
class Panels:
    """The panels of a trial, as a page holds them."""

    trial: TrialPicture

    @cached_property
    def meshes(self) -> list[Mesh]:
        """Of the goal's fragments, then of those of each result."""
        configurations = (self.trial.goal, *(result.fragments for result in self.trial.results))
        return [fragment.mesh for configuration in configurations for fragment in configuration]

    def to_json(self) -> str:
        """The panels as JSON that can stand in an element `script`."""
        goal, results = self.trial.goal, self.trial.results
        goal_colours, reached_colours = pair_colours(len(goal), [(len(r.fragments), r.pairs) for r in results])
        several = len(results) > 1
        matched = {j for result in results for _, j, _ in result.pairs}
        own = [j if j in matched else -1 for j in range(len(goal))]
        placed = {"goal": self._in_place(goal, goal_colours, own, 0)}
        first = len(goal)
        pairs: dict[str, list[Shown]] = {}
        for result, colours in zip(results, reached_colours, strict=True):
            partner = {i: j for i, j, _ in result.pairs}
            numbers = [partner.get(i, -1) for i in range(len(result.fragments))]
            placed[result.title] = self._in_place(result.fragments, colours, numbers, first)
            title = f"matched pairs, {result.title}" if several else "matched pairs"
            pairs[title] = self._pairs(result, colours, first)
            first += len(result.fragments)
        scale = RADIUS / max(self._radius(shown) for shown in placed.values())
        panels = [self._panel(title, shown, scale, True) for title, shown in placed.items()]
        panels += [
            self._panel(title, shown, RADIUS / self._radius(shown), False) for title, shown in pairs.items() if shown
        ]
        data = {"panels": panels, "meshes": pack(self.meshes)}
        return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")

    def _in_place(
        self, configuration: Configuration, colours: Sequence[Colour], pairs: Sequence[int], first: int
    ) -> list[Shown]:
        """A configuration where it is, its middle above the origin; `first` is the number of its first mesh."""
        if not configuration:
            return []
        points = np.concatenate([fragment.X_WF.apply(fragment.mesh.vertices) for fragment in configuration])
        low, high = points.min(axis=0), points.max(axis=0)
        middle = np.array([(low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0, low[2]])
        shifts = apart(configuration, [0] * len(configuration), SPREAD, 0.0)
        return [
            Shown(first + i, colours[i], Pose(f.X_WF.rotation, f.X_WF.position - middle), shifts[i], pairs[i])
            for i, f in enumerate(configuration)
        ]

    def _pairs(self, result: TrialResult, colours: Sequence[Colour], first: int) -> list[Shown]:
        """The matched pairs in rows, best first: the fragment reached, and the goal's as an outline over it, both in
        their canonical frames, as the metric compares them."""
        pairs = sorted(result.pairs, key=lambda pair: -pair[2])
        goal = {j: Solid(self.trial.goal[j].mesh) for _, j, _ in pairs}
        reached = {i: Solid(result.fragments[i].mesh) for i, *_ in pairs}
        solids = [*goal.values(), *reached.values()]
        if not solids:
            return []
        x, y = (2.0 * max(solid.half_extents[axis] for solid in solids) for axis in (2, 1))  # lying down
        gap = GAP * max(x, y)
        columns = max(1, round(float(np.sqrt(len(pairs) * (y + gap) / (x + gap)))))
        rows = -(-len(pairs) // columns)
        shown = []
        for n, (i, j, iou) in enumerate(pairs):
            row, column = divmod(n, columns)
            width = min(columns, len(pairs) - row * columns)
            height = max(goal[j].half_extents[0], reached[i].half_extents[0])
            place = [(column - (width - 1) / 2.0) * (x + gap), ((rows - 1) / 2.0 - row) * (y + gap), height]
            X_PC = Pose(LYING.rotation, np.array(place))
            flip = metric_flip(reached[i], goal[j], iou)
            for number, colour, solid, X_CC in (
                (first + i, colours[i], reached[i], Pose.identity()),
                (j, None, goal[j], flip),
            ):
                shown.append(Shown(number, colour, X_PC @ X_CC @ solid.X_CF, np.zeros(3), j))
        return shown

    def _radius(self, shown: Sequence[Shown]) -> float:
        """Greatest distance from the origin of what is shown, level with the ground [m]."""
        return max(
            (float(np.linalg.norm(one.X_PF.apply(self.meshes[one.mesh].vertices), axis=1).max()) for one in shown),
            default=RADIUS,
        )

    def _panel(self, title: str, shown: Sequence[Shown], scale: float, on_board: bool) -> Mapping[str, Any]:
        fragments = [
            {
                "mesh": one.mesh,
                "pair": one.pair,
                "colour": None if one.colour is None else "#{:02x}{:02x}{:02x}".format(*one.colour),
                "rotation": [round(float(part), 5) for part in one.X_PF.rotation.reshape(-1)],
                "position": [round(scale * float(part), 6) for part in one.X_PF.position],
                "shift": [round(scale * float(part), 6) for part in one.shift],
            }
            for one in shown
        ]
        return {"title": title, "scale": round(scale, 6), "board": on_board, "fragments": fragments}


def metric_flip(reached: Solid, goal: Solid, iou: float) -> Pose:
    """The flip of the goal's canonical frame with which the metric compares a pair whose IoU it recorded."""
    tried = []
    for flip in FLIPS:
        tried.append(reached.iou_with(goal, flip.rotation))
        if tried[-1] > iou - ENOUGH:
            break
    return FLIPS[int(np.argmax(tried))]
