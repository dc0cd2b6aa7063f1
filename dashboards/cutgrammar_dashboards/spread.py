"""Configurations drawn so that every fragment can be seen: moved a little apart, or laid out side by side."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutgrammar.demonstrations import Demonstration
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration
from cutgrammar_dashboards.rendering import Body, Eye
from cutgrammar_dashboards.sheet import seen_size


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
    """Bodies laid out in rows.

    Attributes:
        places: (n, 2) middle of each on the sheet, from the tray's upper left corner [inches].
        size: width and height of the tray [inches].
    """

    places: Floats
    size: tuple[float, float]


def laid_out(bodies: Sequence[Body], eye: Eye, scale: float, width: float, gap: float = 0.05) -> Tray:
    """Bodies side by side in their order, a new row wherever one is full; every row is centred.

    Args:
        bodies: in their order.
        eye: that sees them.
        scale: inches a metre.
        width: of the tray [inches]; a body wider than that has a row of its own.
        gap: between neighbours [inches].
    """
    sizes = [[scale * side + gap for side in seen_size([body], eye)] for body in bodies]
    rows: list[list[int]] = []
    room = -1.0
    for i, (wide, _) in enumerate(sizes):
        if wide > room or not rows:
            rows.append([])
            room = width
        rows[-1].append(i)
        room -= wide
    places = np.zeros((len(bodies), 2))
    y = 0.0
    for row in rows:
        x = (width - sum(sizes[i][0] for i in row)) / 2.0
        high = max(sizes[i][1] for i in row)
        for i in row:
            places[i] = x + sizes[i][0] / 2.0, y + high / 2.0
            x += sizes[i][0]
        y += high
    return Tray(places, (max((sum(sizes[i][0] for i in row) for row in rows), default=0.0), y))


def fitting_scale(trays: Sequence[Sequence[Body]], eye: Eye, width: float, height: float) -> float:
    """The greatest scale [inches a metre], to 2 %, at which each of these sets of bodies fits `width` x `height`."""

    def fits(scale: float) -> bool:
        sizes = [laid_out(bodies, eye, scale, width).size for bodies in trays]
        return all(wide <= width and high <= height for wide, high in sizes)

    scale = 0.1
    while fits(2.0 * scale) and scale < 1e4:
        scale *= 2.0
    step = scale
    while step > 0.02 * scale:
        step /= 2.0
        if fits(scale + step):
            scale += step
    return scale


def _centre(points: Floats) -> Floats:
    return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2.0)
