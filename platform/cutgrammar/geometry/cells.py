"""How much of a solid lies in each cell of a box grid about the origin, exact: the volume form of a coarse picture.

Along every axis a grid has `2 half` cells of one size, half of them on either side of zero, the outermost ones
reaching to infinity; turning a solid by one of `FLIPS` therefore only reverses axes of its table of volumes. Every
triangle is clipped to the cells it crosses. Of a line along z that leaves the solid at height z with sign s = +1, or
enters it with s = -1, the part inside a cell from z0 to z1 is the sum of s (min(max(z, z0), z1) - z0), so a piece adds
to its own cell and to all those below it. Sliver triangles add as little as their area, and nothing is divided by it.
"""

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats

CORNERS = 16
"""Room for the corners of a clipped triangle: three, and one for each of six clips, with some to spare."""


def cell_volumes(triangles: Floats, sizes: Floats, half: int) -> Floats:
    """(2 half, 2 half, 2 half) volume of a closed mesh in every cell [m3].

    Args:
        triangles: (m, 3, 3) corners of every triangle, counter-clockwise seen from outside, in the grid's frame [m].
        sizes: (3,) of a cell along x, y, z [m].
        half: number of cells on either side of zero.
    """
    areas = np.zeros((2 * half,) * 3)
    inside = np.zeros((2 * half,) * 3)
    _clip_all(np.ascontiguousarray(triangles), sizes, half, areas, inside)
    above = np.cumsum(areas[:, :, ::-1], axis=2)[:, :, ::-1] - areas
    volumes: Floats = np.maximum(inside + above * sizes[2], 0.0)
    return volumes


@njit(cache=True)
def _clip_all(triangles, sizes, half, areas, inside):  # type: ignore[no-untyped-def]
    """Sum over the pieces in each cell their area seen along z, and that area times their height above the cell."""
    by_x = np.empty((CORNERS, 3))
    by_y = np.empty((CORNERS, 3))
    by_z = np.empty((CORNERS, 3))
    room = np.empty((CORNERS, 3))
    for t in range(len(triangles)):
        corners = triangles[t]
        first_x, last_x = _cells_met(corners, 3, 0, sizes[0], half)
        for i in range(first_x, last_x + 1):
            in_x = _slab(corners, 3, 0, i, first_x, last_x, sizes[0], half, by_x, room)
            if in_x < 3:
                continue
            first_y, last_y = _cells_met(by_x, in_x, 1, sizes[1], half)
            for j in range(first_y, last_y + 1):
                in_y = _slab(by_x, in_x, 1, j, first_y, last_y, sizes[1], half, by_y, room)
                if in_y < 3:
                    continue
                first_z, last_z = _cells_met(by_y, in_y, 2, sizes[2], half)
                for k in range(first_z, last_z + 1):
                    in_z = _slab(by_y, in_y, 2, k, first_z, last_z, sizes[2], half, by_z, room)
                    floor = (k - half) * sizes[2]
                    for c in range(1, in_z - 1):
                        ux, uy = by_z[c, 0] - by_z[0, 0], by_z[c, 1] - by_z[0, 1]
                        vx, vy = by_z[c + 1, 0] - by_z[0, 0], by_z[c + 1, 1] - by_z[0, 1]
                        area = (ux * vy - uy * vx) / 2.0
                        areas[i, j, k] += area
                        inside[i, j, k] += area * ((by_z[0, 2] + by_z[c, 2] + by_z[c + 1, 2]) / 3.0 - floor)


@njit(cache=True)
def _cells_met(corners, count, axis, size, half):  # type: ignore[no-untyped-def]
    """First and last cell along `axis` that the polygon reaches into."""
    lowest = highest = corners[0, axis]
    for c in range(1, count):
        lowest = min(lowest, corners[c, axis])
        highest = max(highest, corners[c, axis])
    first = min(max(int(np.floor(lowest / size)) + half, 0), 2 * half - 1)
    last = min(max(int(np.ceil(highest / size)) - 1 + half, first), 2 * half - 1)
    return first, last


@njit(cache=True)
def _slab(corners, count, axis, cell, first, last, size, half, out, room):  # type: ignore[no-untyped-def]
    """The part of a polygon within a cell's bounds along one axis, into `out`; its number of corners."""
    source, number = corners, count
    if cell > first:
        number = _clip(source, number, axis, (cell - half) * size, 1.0, room)
        source = room
    if cell < last:
        return _clip(source, number, axis, (cell + 1 - half) * size, -1.0, out)
    for c in range(number):
        for d in range(3):
            out[c, d] = source[c, d]
    return number


@njit(cache=True)
def _clip(corners, count, axis, at, sign, out):  # type: ignore[no-untyped-def]
    """The part of a polygon where sign (coordinate - at) >= 0, into `out`; its number of corners."""
    number = 0
    for c in range(count):
        n = (c + 1) % count
        here, there = sign * (corners[c, axis] - at), sign * (corners[n, axis] - at)
        if here >= 0.0:
            for d in range(3):
                out[number, d] = corners[c, d]
            number += 1
        if (here > 0.0 and there < 0.0) or (here < 0.0 and there > 0.0):
            share = here / (here - there)
            for d in range(3):
                out[number, d] = corners[c, d] + share * (corners[n, d] - corners[c, d])
            out[number, axis] = at
            number += 1
    return number
