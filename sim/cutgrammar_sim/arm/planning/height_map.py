"""What stands on the board as the arm sees it from above: a map of heights.

The arm works from above, so that whatever lies under the top of a fragment counts as taken: a map says how high each
cell of a grid is taken, by the fragments' convex hulls. A ball clears the map when its lowest point is above every cell
within its radius. That errs on the safe side by at most a cell, and a posture costs some look-ups.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import maximum_filter
from scipy.spatial import ConvexHull

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Fragment, Mesh

CELL = 4e-3
"""Width of a cell [m]."""
PAD = 0.12
"""How far the map reaches beyond the fragments; everything farther away is bare board [m]."""
SPACING = 8e-3
"""Between the points that stand for the surface of a fragment [m]."""
KEPT = 96
"""Fragments whose hulls are kept at hand: some more than lie on a board at once."""


@lru_cache(maxsize=KEPT)
def hull_of(mesh: Mesh) -> tuple[Floats, Ints, Floats]:
    """The convex hull of a mesh in F: (k, 3) corners, (m, 3) triangles of them, (m, 4) outward planes n.v + d <= 0."""
    hull = ConvexHull(mesh.vertices)
    number = np.zeros(len(mesh.vertices), dtype=np.int64)
    number[hull.vertices] = np.arange(len(hull.vertices))
    return np.asarray(mesh.vertices[hull.vertices]), number[hull.simplices], np.asarray(hull.equations)


@lru_cache(maxsize=KEPT)
def surface_points(mesh: Mesh) -> Floats:
    """(k, 3) points in F on the convex hull of a mesh, about `SPACING` apart, its corners among them [m]."""
    corners, triangles, _ = hull_of(mesh)
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    longest = np.max([np.linalg.norm(b - a, axis=1), np.linalg.norm(c - b, axis=1), np.linalg.norm(a - c, axis=1)], 0)
    parts = np.ceil(longest / SPACING).astype(int)
    points = [corners]
    for n in np.unique(parts[parts > 1]):
        i, j = np.array([(i, j) for i in range(n + 1) for j in range(n + 1 - i)]).T / n
        some = parts == n
        inner = a[some][:, None] + i[:, None] * (b[some] - a[some])[:, None] + j[:, None] * (c[some] - a[some])[:, None]
        points.append(inner.reshape(-1, 3))
    found = np.concatenate(points)
    _, first = np.unique(np.round(found / (SPACING / 3)), axis=0, return_index=True)  # one of those close together
    return np.concatenate([corners, found[np.sort(first[first >= len(corners)])]])


@dataclass(frozen=True, eq=False)
class Stamp:
    """What one fragment takes of the map.

    Attributes:
        first: (2,) the cell it begins at; cell (0, 0) has a corner at x = y = 0 of W.
        top: (a, b) how high each cell from there on is taken, 0 where it is not [m].
    """

    first: Ints
    top: Floats


def stamp_of(fragment: Fragment) -> Stamp:
    """What the convex hull of `fragment` takes of the map; a cell counts as taken where any part of it is."""
    corners, _, equations = hull_of(fragment.mesh)
    corners = fragment.X_WF.apply(corners)
    first = np.floor(corners[:, :2].min(axis=0) / CELL).astype(np.int64)
    last = np.floor(corners[:, :2].max(axis=0) / CELL).astype(np.int64)
    x, y = (CELL * (np.arange(first[i], last[i] + 1) + 0.5) for i in range(2))
    normals = fragment.X_WF.rotate(equations[:, :3])
    offsets = equations[:, 3] - normals @ fragment.X_WF.position
    # n.v + d <= 0 holds somewhere within half a cell of its middle if it holds there less strictly by so much
    loose = CELL / 2.0 * (np.abs(normals[:, 0]) + np.abs(normals[:, 1]))
    level = normals[:, 0, None, None] * x[:, None] + normals[:, 1, None, None] * y + (offsets - loose)[:, None, None]
    up, down = normals[:, 2] > 1e-9, normals[:, 2] < -1e-9
    top = np.min(-level[up] / normals[up, 2, None, None], axis=0)
    bottom = np.max(-level[down] / normals[down, 2, None, None], axis=0)
    there = (top >= bottom) & (level[~up & ~down] <= 0.0).all(axis=0)
    return Stamp(first, np.where(there, np.clip(top, 0.0, max(float(corners[:, 2].max()), 0.0)), 0.0))


ROUND = 0.0125
"""Up to this radius balls are held against the map as balls [m]."""


class Heights:
    """A map of what some fragments take of the space above the board.

    Attributes:
        cell: width of a cell [m].
        tallest: greatest height of any fragment [m].
        taken: (k, 2) middles of the cells in which something stands, x and y in W [m].
    """

    def __init__(self, stamps: Iterable[Stamp]) -> None:
        stamps = self._stamps = list(stamps)
        margin = int(np.ceil(PAD / CELL))
        first = np.min([s.first for s in stamps] or [np.zeros(2, dtype=np.int64)], axis=0) - margin
        end = np.max([s.first + s.top.shape for s in stamps] or [np.zeros(2, dtype=np.int64)], axis=0) + margin
        self._first = first
        self.cell = CELL
        self._map = np.zeros(end - first)
        for stamp in stamps:
            i, j = stamp.first - first
            part = self._map[i : i + stamp.top.shape[0], j : j + stamp.top.shape[1]]
            np.maximum(part, stamp.top, out=part)
        self.tallest = float(self._map.max())
        self.taken: Floats = CELL * (first + np.argwhere(self._map > 0.0) + 0.5)
        self._grown: dict[float, Floats] = {}

    def with_stamp(self, stamp: Stamp) -> "Heights":
        """The map when one more fragment stands there."""
        return Heights([*self._stamps, stamp])

    @property
    def low(self) -> Floats:
        """(2,) corner of the map with the least x and y, in W [m]."""
        return np.asarray(CELL * self._first, dtype=np.float64)

    def grown(self, radius: float) -> Floats:
        """(a, b) how high, at least, the lowest point of a ball must be that is over a cell; 0 at the rim [m].

        A large ball counts as a cylinder: whatever stands within its radius, seen from above, is to be under it.
        """
        if radius not in self._grown:
            cells = int(np.ceil(radius / CELL))
            if radius > ROUND:
                self._grown[radius] = maximum_filter(self._map, size=2 * cells + 1, mode="constant")
            else:
                self._grown[radius] = self._under_ball(radius, cells)
        return self._grown[radius]

    def _under_ball(self, radius: float, cells: int) -> Floats:
        padded = np.pad(self._map, cells)
        grown = np.zeros_like(self._map)
        rows, columns = self._map.shape
        for i in range(-cells, cells + 1):
            for j in range(-cells, cells + 1):
                aside = CELL * np.hypot(max(abs(i) - 1, 0), max(abs(j) - 1, 0))  # at least, from any to any point
                if aside <= radius:
                    spared = radius - np.sqrt(radius**2 - aside**2)
                    part = padded[cells + i : cells + i + rows, cells + j : cells + j + columns]
                    np.maximum(grown, part - spared, out=grown)
        return grown

    def room(self, p_WM: Floats, radius: float) -> Floats:
        """(...) how far balls about p_WM (..., 3) could sink before they touch [m]; negative: they are in it."""
        grown = self.grown(radius)
        cell = np.floor(p_WM[..., :2] / CELL).astype(np.int64) - self._first
        np.clip(cell, 0, np.array(grown.shape) - 1, out=cell)
        return np.asarray(p_WM[..., 2] - radius - grown[cell[..., 0], cell[..., 1]])
