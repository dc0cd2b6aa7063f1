"""Exact volumes of a solid within the cells of a grid about the origin: a coarse volumetric description.

Along every axis the grid has `2 half` cells of equal size, half of them on either side of zero; the outermost cells
extend to infinity. Rotating a solid by one of `FLIPS` therefore only reverses axes of its array of volumes.

Every triangle is clipped to the cells that it crosses. Consider a line along z that leaves the solid at height z with
sign s = +1, or enters it with s = -1: its length within the cell from z0 to z1 is the sum of s (min(max(z, z0), z1) -
z0). A clipped polygon therefore contributes to its own cell and to all cells below. Sliver triangles contribute in
proportion to their area, and nothing is divided by it.
"""

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats

MAX_CORNERS = 16
"""Buffer size for the corners of a clipped triangle: three, plus at most one for each of six clips."""


def cell_volumes(triangles: Floats, sizes: Floats, half: int) -> Floats:
    """(2 half, 2 half, 2 half) volume of a closed mesh within every cell [m3].

    Args:
        triangles: (m, 3, 3) corners of the triangles, counter-clockwise seen from outside, in the grid's frame [m].
        sizes: (3,) size of a cell along x, y, z [m].
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
    """For each cell, sum the projected area along z of the clipped polygons, and that area times their height in it."""
    by_x = np.empty((MAX_CORNERS, 3))
    by_y = np.empty((MAX_CORNERS, 3))
    by_z = np.empty((MAX_CORNERS, 3))
    buffer = np.empty((MAX_CORNERS, 3))
    for t in range(len(triangles)):
        corners = triangles[t]
        first_x, last_x = _cell_range(corners, 3, 0, sizes[0], half)
        for i in range(first_x, last_x + 1):
            in_x = _slab(corners, 3, 0, i, first_x, last_x, sizes[0], half, by_x, buffer)
            if in_x < 3:
                continue
            first_y, last_y = _cell_range(by_x, in_x, 1, sizes[1], half)
            for j in range(first_y, last_y + 1):
                in_y = _slab(by_x, in_x, 1, j, first_y, last_y, sizes[1], half, by_y, buffer)
                if in_y < 3:
                    continue
                first_z, last_z = _cell_range(by_y, in_y, 2, sizes[2], half)
                for k in range(first_z, last_z + 1):
                    in_z = _slab(by_y, in_y, 2, k, first_z, last_z, sizes[2], half, by_z, buffer)
                    floor = (k - half) * sizes[2]
                    for c in range(1, in_z - 1):
                        ux, uy = by_z[c, 0] - by_z[0, 0], by_z[c, 1] - by_z[0, 1]
                        vx, vy = by_z[c + 1, 0] - by_z[0, 0], by_z[c + 1, 1] - by_z[0, 1]
                        area = (ux * vy - uy * vx) / 2.0
                        areas[i, j, k] += area
                        inside[i, j, k] += area * ((by_z[0, 2] + by_z[c, 2] + by_z[c + 1, 2]) / 3.0 - floor)


@njit(cache=True)
def _cell_range(corners, n_corners, axis, size, half):  # type: ignore[no-untyped-def]
    """First and last cell along `axis` that the polygon intersects."""
    lowest = highest = corners[0, axis]
    for c in range(1, n_corners):
        lowest = min(lowest, corners[c, axis])
        highest = max(highest, corners[c, axis])
    first = min(max(int(np.floor(lowest / size)) + half, 0), 2 * half - 1)
    last = min(max(int(np.ceil(highest / size)) - 1 + half, first), 2 * half - 1)
    return first, last


@njit(cache=True)
def _slab(corners, n_corners, axis, cell, first, last, size, half, out, buffer):  # type: ignore[no-untyped-def]
    """Clip a polygon to a cell's bounds along one axis, into `out`; return its number of corners."""
    source, n_source = corners, n_corners
    if cell > first:
        n_source = _clip(source, n_source, axis, (cell - half) * size, 1.0, buffer)
        source = buffer
    if cell < last:
        return _clip(source, n_source, axis, (cell + 1 - half) * size, -1.0, out)
    for c in range(n_source):
        for d in range(3):
            out[c, d] = source[c, d]
    return n_source


@njit(cache=True)
def _clip(corners, n_corners, axis, at, sign, out):  # type: ignore[no-untyped-def]
    """Clip a polygon to sign (coordinate - at) >= 0, into `out`; return its number of corners."""
    n_out = 0
    for c in range(n_corners):
        n = (c + 1) % n_corners
        current, following = sign * (corners[c, axis] - at), sign * (corners[n, axis] - at)
        if current >= 0.0:
            for d in range(3):
                out[n_out, d] = corners[c, d]
            n_out += 1
        if (current > 0.0 and following < 0.0) or (current < 0.0 and following > 0.0):
            share = current / (current - following)
            for d in range(3):
                out[n_out, d] = corners[c, d] + share * (corners[n, d] - corners[c, d])
            out[n_out, axis] = at
            n_out += 1
    return n_out
