"""Configurations drawn so that every fragment can be seen: moved a little apart, or laid out side by side."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutgrammar.demonstration import Demonstration
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration
from cutgrammar_dashboards.figures.layout.sheet import seen_size
from cutgrammar_dashboards.rendering.body import Body
from cutgrammar_dashboards.rendering.drawing import Eye


def apart(configuration: Configuration, groups: Sequence[int], within: float, between: float) -> list[Floats]:
    """A shift (3,) [m] for every fragment, away from the middle of its group, and of the groups from one another.

    Args:
        configuration: the fragments.
        groups: (n,) which of them belong together, e.g. the object that each was cut from.
        within: share of the distance from the group's middle that is added.
        between: share of the distance of the groups' middles from the middle of all that is added.
    """
    places = np.array([fragment.p_WC for fragment in configuration])
    middles = {group: _centre(places[np.array(groups) == group]) for group in set(groups)}
    middle = _centre(np.array(list(middles.values())))
    shifts = [within * (p - middles[g]) + between * (middles[g] - middle) for p, g in zip(places, groups, strict=True)]
    lowest = min(float(shift[2]) for shift in shifts)
    return [shift - [0.0, 0.0, lowest] for shift in shifts]


def objects_of(demonstration: Demonstration, step: int) -> list[int]:
    """The initial object that each fragment of `demonstration.configuration(step)` was cut from."""

    def root(fragment: int) -> int:
        parent = demonstration.fragments[fragment].parent
        return fragment if parent is None else root(parent)

    return [root(fragment) for fragment in demonstration.alive(step)]


@dataclass(frozen=True, eq=False)
class Tray:
    """Bodies laid out in rows, each centred, in their order.

    Attributes:
        bodies: moved within the picture, so that one picture shows them all.
        size: width and height of the tray [m].
    """

    bodies: tuple[Body, ...]
    size: tuple[float, float]


def laid_out(bodies: Sequence[Body], eye: Eye, width: float, gap: float) -> Tray:
    """Bodies side by side as `eye` sees them, a new row wherever one is full.

    Args:
        bodies: in their order.
        eye: that sees them.
        width: of the tray [m]; a body wider than that has a row of its own.
        gap: between neighbours [m].
    """
    seen = [body.vertices @ eye.axes.T for body in bodies]
    sizes = np.array([np.ptp(points, axis=0) for points in seen]) + gap
    middles = np.array([_centre(points) for points in seen])
    rows = _rows(sizes[:, 0], width)
    places = np.zeros((len(bodies), 2))
    y = 0.0
    for row in rows:
        ends = np.cumsum(sizes[row, 0])
        places[row, 0] = ends - sizes[row, 0] / 2.0 - ends[-1] / 2.0
        places[row, 1] = -y - sizes[row, 1].max() / 2.0
        y += float(sizes[row, 1].max())
    moved = tuple(body.shifted(shift @ eye.axes) for body, shift in zip(bodies, places - middles, strict=True))
    return Tray(moved, (max(float(sizes[row, 0].sum()) for row in rows), y))


def fitting_scale(trays: Sequence[Sequence[Body]], eye: Eye, width: float, height: float, gap: float) -> float:
    """The greatest scale [inches a metre], to 2 %, at which each of these sets of bodies fits `width` x `height`.

    Args:
        trays: the sets of bodies.
        eye: that sees them.
        width, height: what they are to fit into [inches].
        gap: between neighbours [inches].
    """
    sizes = [np.array([seen_size([body], eye) for body in bodies]) for bodies in trays]

    def fits(scale: float) -> bool:
        for raw in sizes:
            sides = scale * raw + gap
            rows = _rows(sides[:, 0], width)
            high = sum(float(sides[row, 1].max()) for row in rows)
            if high > height or max(float(sides[row, 0].sum()) for row in rows) > width:
                return False
        return True

    scale = 0.1
    while fits(2.0 * scale) and scale < 1e4:
        scale *= 2.0
    step = scale
    while step > 0.02 * scale:
        step /= 2.0
        if fits(scale + step):
            scale += step
    return scale


def _rows(widths: Floats, width: float) -> list[list[int]]:
    """Numbers of the things in each row, if things this wide are set one after another into rows this wide."""
    rows: list[list[int]] = []
    room = 0.0
    for i, wide in enumerate(widths.tolist()):
        if not rows or wide > room:
            rows.append([])
            room = width
        rows[-1].append(i)
        room -= wide
    return rows


def _centre(points: Floats) -> Floats:
    return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2.0)
