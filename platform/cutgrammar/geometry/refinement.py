"""IoU after the rotation is refined: where principal axes are noise, two like fragments need not lie alike in them.

The centroids stay on one another; only the rotation is sought, by compass search (the pattern search of Hooke and
Jeeves without its pattern moves; Kolda, Lewis and Torczon 2003) from each of the four proper choices of signs. It goes
by a stand-in for the shared volume, the lesser of how far the two solids reach from the centroid, in all directions;
for solids that can be seen whole from there the stand-in differs from the volume by its finite number of directions
alone. The exact IoU is taken of the best rotation found, and of no other.
"""

from functools import cache, lru_cache

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import FLIPS
from cutgrammar.geometry.overlap import Solid

DIRECTIONS = 256
"""Number of directions in which the two solids are compared."""
SIDE = 12
"""Squares along the edge of the cube on whose surface the reach of a solid is tabled."""
FIRST, LAST = np.radians(16.0), np.radians(0.5)
"""First and last step of the compass search [rad]; a step is halved where no direction is better."""
GAIN = 1e-9
"""A rotation is better if the stand-in grows by more than this share."""
ASIDE = np.array([1.3e-7, -2.1e-7, 3.7e-7])
"""How far lines pass beside the points they are named by, lest they meet the very edges of boxes."""


def refined_iou(a: Solid, b: Solid, plain: float) -> float:
    """Intersection over union of two solids about their centroids, exact, in the best rotation found.

    Args:
        a, b: the solids.
        plain: their IoU in the best of the four flips; the result is never under it.
    """
    starts = np.array([flip.rotation for flip in FLIPS])
    turn: Floats = _best_turn(*_rays(a), a.reach, _table(b), b.reach, starts, FIRST, LAST)
    return max(plain, a.iou_with(b, turn))


@lru_cache(maxsize=512)
def _rays(solid: Solid) -> tuple[Floats, Floats]:
    """(p, 3) directions spread evenly where the solid's half extents are 1, and how far it reaches (p,) along each."""
    directions = _spread()
    return directions, reaches(solid.mesh.triangles / solid.reach, directions)


@lru_cache(maxsize=512)
def _table(solid: Solid) -> Floats:
    """(3, 2, s, s) how far the solid reaches, as a multiple, along points of the cube, where its half extents are 1."""
    points = _cube()
    table: Floats = reaches(solid.mesh.triangles / solid.reach, points.reshape(-1, 3))
    return table.reshape(points.shape[:-1])


@cache
def _spread() -> Floats:
    """(p, 3) unit vectors on the spiral of Fibonacci."""
    steps = np.arange(DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * steps / DIRECTIONS
    around = np.pi * (1.0 + np.sqrt(5.0)) * steps
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(around), across * np.sin(around), z], axis=1)


@cache
def _cube() -> Floats:
    """(3, 2, s, s, 3) points on the cube's surface by axis, side (-1, 1), and the coordinates on the next two axes."""
    along = np.linspace(-1.0, 1.0, SIDE + 1)
    points = np.empty((3, 2, SIDE + 1, SIDE + 1, 3))
    for axis in range(3):
        points[axis, 0, ..., axis], points[axis, 1, ..., axis] = -1.0, 1.0
        points[axis, ..., (axis + 1) % 3] = along[:, None]
        points[axis, ..., (axis + 2) % 3] = along
    return points


def reaches(triangles: Floats, directions: Floats) -> Floats:
    """(p,) how far a closed mesh reaches from the origin along each direction (p, 3), as a multiple of its length.

    Where a line leaves the mesh and meets it again the multiple is the one that encloses as much of a narrow cone. Two
    triangles decide alike on which side of their common edge a line passes, so that none slips through.
    """
    crosses = np.cross(triangles, np.roll(triangles, -1, axis=1))
    volumes = np.einsum("ij,ij->i", triangles[:, 2], crosses[:, 0])
    furthest = np.sqrt((triangles**2).sum(axis=2).max())
    lines = directions + ASIDE
    signed: Floats = _cubed_reaches(crosses, volumes, lines, furthest / np.linalg.norm(lines, axis=1))
    return np.cbrt(np.maximum(signed, 0.0))


@njit(cache=True)
def _cubed_reaches(crosses: Floats, volumes: Floats, lines: Floats, most: Floats) -> Floats:
    """(p,) sum of the cubes of the multiples at which each line (p, 3) leaves the mesh, less those at which it enters.

    Args:
        crosses: (m, 3, 3) cross products of every triangle's neighbouring corners.
        volumes: (m,) six times the volume between the origin and every triangle.
        lines: (p, 3).
        most: (p,) multiples beyond which there is nothing.
    """
    found = np.zeros(len(lines))
    for t in range(len(crosses)):
        volume = volumes[t]
        for p in range(len(lines)):
            x, y, z = lines[p, 0], lines[p, 1], lines[p, 2]
            first = x * crosses[t, 0, 0] + y * crosses[t, 0, 1] + z * crosses[t, 0, 2]
            second = x * crosses[t, 1, 0] + y * crosses[t, 1, 1] + z * crosses[t, 1, 2]
            third = x * crosses[t, 2, 0] + y * crosses[t, 2, 1] + z * crosses[t, 2, 2]
            leaves = first >= 0.0 and second >= 0.0 and third >= 0.0 and volume > 0.0
            enters = first <= 0.0 and second <= 0.0 and third <= 0.0 and volume < 0.0
            total = first + second + third
            if (leaves or enters) and total != 0.0:
                multiple = min(volume / total, most[p])
                found[p] += multiple**3 if leaves else -(multiple**3)
    return found


@njit(cache=True)
def _best_turn(
    directions: Floats,
    far: Floats,
    from_a: Floats,
    table: Floats,
    from_b: Floats,
    starts: Floats,
    first: float,
    last: float,
) -> Floats:
    """The rotation (3, 3) of the second solid at which it shares most with the first, of those climbed to.

    Args:
        directions, far: (p, 3), (p,) of `_rays` of the first solid.
        from_a: (3,) half extents of the first solid [m].
        table: of `_table` of the second.
        from_b: (3,) half extents of the second [m].
        starts: (s, 3, 3) rotations to climb from.
        first, last: steps [rad].
    """
    best = -1.0
    found: Floats = starts[0].copy()
    for s in range(len(starts)):
        turn: Floats = starts[s].copy()
        here = _shared(directions, far, from_a, table, from_b, turn)
        step = first
        while step >= last:
            better = False
            for axis in range(3):
                for sign in (-1.0, 1.0):
                    tried: Floats = _turned(turn, axis, sign * step)
                    there = _shared(directions, far, from_a, table, from_b, tried)
                    if there > here * (1.0 + GAIN):
                        turn, here, better = tried, there, True
            if not better:
                step /= 2.0
        if here > best * (1.0 + GAIN):
            best, found = here, turn
    return found


@njit(cache=True)
def _turned(turn: Floats, axis: int, angle: float) -> Floats:
    """A rotation (3, 3), turned further about a coordinate axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    further = turn.copy()
    for k in range(3):
        further[i, k] = c * turn[i, k] - s * turn[j, k]
        further[j, k] = s * turn[i, k] + c * turn[j, k]
    return further


@njit(cache=True)
def _shared(directions: Floats, far: Floats, from_a: Floats, table: Floats, from_b: Floats, turn: Floats) -> float:
    """The stand-in for the volume shared under `turn`, in units that depend on the first solid alone."""
    m = np.empty((3, 3))  # from the directions of the first solid to those of the second
    for i in range(3):
        for j in range(3):
            m[i, j] = turn[j, i] * from_a[j] / from_b[i]
    side = table.shape[2] - 1
    seen = np.empty(3)
    total = 0.0
    for p in range(len(directions)):
        x, y, z = directions[p, 0], directions[p, 1], directions[p, 2]
        for i in range(3):
            seen[i] = m[i, 0] * x + m[i, 1] * y + m[i, 2] * z
        axis = 0
        for i in range(1, 3):
            if abs(seen[i]) > abs(seen[axis]):
                axis = i
        length = abs(seen[axis])
        face = table[axis, 1 if seen[axis] > 0.0 else 0]
        u = (seen[(axis + 1) % 3] / length + 1.0) / 2.0 * side
        v = (seen[(axis + 2) % 3] / length + 1.0) / 2.0 * side
        i, j = min(int(u), side - 1), min(int(v), side - 1)
        u, v = u - i, v - j
        near = (face[i, j] * (1.0 - v) + face[i, j + 1] * v) * (1.0 - u)
        near += (face[i + 1, j] * (1.0 - v) + face[i + 1, j + 1] * v) * u
        total += min(far[p], near / length) ** 3
    return total
