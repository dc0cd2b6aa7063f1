"""Fragments arranged so that each can be seen: moved a little apart, or laid out side by side."""

from collections.abc import Sequence

import numpy as np

from cutgrammar.demonstration import Demonstration
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration
from cutgrammar_dashboards.figures.layout.sheet import seen_size
from cutgrammar_dashboards.rendering.body import Body, body_of_fragment
from cutgrammar_dashboards.rendering.drawing import Eye
from cutgrammar_dashboards.rendering.palette import Colour

MAX_SCALE, STEP = 1e4, 0.02
"""Greatest scale that is tried [inches a metre], and relative step to the next."""


def apart(configuration: Configuration, groups: Sequence[int], within: float, between: float) -> list[Floats]:
    """Shifts (3,) [m] that move every fragment away from the middle of its group, and the groups from one another.

    Args:
        configuration: the fragments.
        groups: (n,) the group of every fragment, e.g. the object that it was cut from.
        within: share of a fragment's distance from its group's middle that is added.
        between: share of a group's distance from the middle of all groups that is added.
    """
    centroids = np.array([fragment.p_WC for fragment in configuration])
    middles = {group: _middle(centroids[np.array(groups) == group]) for group in set(groups)}
    middle = _middle(np.array(list(middles.values())))
    shifts = [
        within * (centroid - middles[group]) + between * (middles[group] - middle)
        for centroid, group in zip(centroids, groups, strict=True)
    ]
    lowest = min((float(shift[2]) for shift in shifts), default=0.0)
    return [shift - [0.0, 0.0, lowest] for shift in shifts]


def bodies_apart(configuration: Configuration, colours: Sequence[Colour], spread: float) -> list[Body]:
    """The fragments in their colours, each moved away from the middle by a share of its distance from it."""
    shifts = apart(configuration, [0] * len(configuration), spread, 0.0) if configuration else []
    return [body_of_fragment(f, c, shift) for f, c, shift in zip(configuration, colours, shifts, strict=True)]


def objects_of(demonstration: Demonstration, step: int) -> list[int]:
    """The initial object that each fragment of `demonstration.configuration(step)` was cut from."""

    def root(fragment: int) -> int:
        parent = demonstration.fragments[fragment].parent
        return fragment if parent is None else root(parent)

    return [root(fragment) for fragment in demonstration.alive(step)]


def laid_out(bodies: Sequence[Body], eye: Eye, width: float, gap: float) -> list[Body]:
    """Bodies side by side in centred rows, moved across the line of sight, so that one drawing shows them all.

    Args:
        bodies: in their order.
        eye: that sees them.
        width: of the rows [m]; a body wider than that has a row of its own.
        gap: between neighbours [m].
    """
    seen = [body.vertices @ eye.axes.T for body in bodies]
    sizes = np.array([np.ptp(points, axis=0) for points in seen]) + gap
    middles = np.array([_middle(points) for points in seen])
    targets = np.zeros((len(bodies), 2))
    y = 0.0
    for row in _rows(sizes[:, 0], width):
        ends = np.cumsum(sizes[row, 0])
        targets[row, 0] = ends - sizes[row, 0] / 2.0 - ends[-1] / 2.0
        targets[row, 1] = -y - sizes[row, 1].max() / 2.0
        y += float(sizes[row, 1].max())
    return [body.shifted(move @ eye.axes) for body, move in zip(bodies, targets - middles, strict=True)]


def fitting_scale(sets: Sequence[Sequence[Body]], eye: Eye, width: float, height: float, gap: float) -> float:
    """The greatest scale [inches a metre], to 2 %, at which each of these sets of bodies fits `width` x `height`.

    Args:
        sets: of bodies, each to be laid out by itself.
        eye: that sees them.
        width, height: of the space for each set [inches].
        gap: between neighbours [inches].
    """
    sizes = [np.array([seen_size([body], eye) for body in bodies]) for bodies in sets]

    def fits(scale: float) -> bool:
        for raw in sizes:
            scaled = scale * raw + gap
            rows = _rows(scaled[:, 0], width)
            used = sum(float(scaled[row, 1].max()) for row in rows)
            if used > height or max(float(scaled[row, 0].sum()) for row in rows) > width:
                return False
        return True

    scales = MAX_SCALE * (1.0 - STEP) ** np.arange(600)
    return float(next((scale for scale in scales if fits(scale)), scales[-1]))


def _rows(widths: Floats, max_width: float) -> list[list[int]]:
    """Indices in each row, if things of these widths are set one after another into rows of `max_width`."""
    rows: list[list[int]] = []
    free = 0.0
    for i, width in enumerate(widths.tolist()):
        if not rows or width > free:
            rows.append([])
            free = max_width
        rows[-1].append(i)
        free -= width
    return rows


def _middle(points: Floats) -> Floats:
    return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2.0)
