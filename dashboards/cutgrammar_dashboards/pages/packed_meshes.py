"""Meshes as a few bytes in a page: quantised, delta-coded, deflated.

A mesh of n vertices and m triangles becomes 3 n + 3 m whole numbers of 16 bits, all low bytes before all high bytes:

- the vertices in the order in which triangles use them first, in steps of a 4,096th of the longest side of their
  bounding box, each as its difference from the one before, all x before all y before all z; differences are written
  as 0, -1, 1, -2, 2, ... -> 0, 1, 2, 3, 4, ...
- the vertices of the triangles, each as the number by which it is below the first that no triangle has used yet.

Both make small numbers of most, which deflate well: 2.5 bytes a triangle of food, before base64.
"""

import base64
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Mesh

STEPS = 4096
"""Number of different coordinates along the longest side of a mesh."""
MAX_FACES = 6000
"""Meshes of more triangles are simplified."""
GRIDS = (256, 128, 96, 64, 48, 32, 24, 16, 12, 8)
"""Cells along the longest side of a mesh, within which vertices are merged to simplify it, tried in turn."""


def pack(meshes: Sequence[Mesh]) -> dict[str, Any]:
    """Meshes as JSON.

    Returns:
        `sizes`: for each mesh the number of vertices and of triangles, the step [m], and the lowest corner (3,) [m];
        `data`: the numbers of all meshes, deflated, in base64.
    """
    sizes, parts = [], []
    for mesh in meshes:
        vertices, faces = simplified(mesh.vertices, mesh.faces)
        used, first, fresh = np.unique(faces.reshape(-1), return_index=True, return_inverse=True)
        order = np.argsort(first)
        vertices, corners = vertices[used][order], np.argsort(order)[fresh]
        low = vertices.min(axis=0)
        step = float(np.ptp(vertices, axis=0).max()) / (STEPS - 1)
        steps = np.rint((vertices - low) / step).astype(np.int64)
        differences = np.diff(steps, axis=0, prepend=0).T.reshape(-1)
        unused = np.concatenate([[0], np.maximum.accumulate(corners)[:-1] + 1])
        numbers = np.concatenate([np.where(differences < 0, -2 * differences - 1, 2 * differences), unused - corners])
        content = numbers.astype("<u2").view(np.uint8)
        parts.append(content[::2].tobytes() + content[1::2].tobytes())
        sizes.append([len(vertices), len(faces), _short(step), *map(_short, low)])
    return {"sizes": sizes, "data": base64.b64encode(zlib.compress(b"".join(parts), 9)).decode()}


def simplified(vertices: Floats, faces: Ints, max_faces: int = MAX_FACES) -> tuple[Floats, Ints]:
    """A mesh of at most `max_faces` triangles, or of as few as the coarsest of `GRIDS` leaves, for looking at only.

    Vertices (n, 3) in one cell of a grid become their mean, and triangles (m, 3) that are then without area are left
    out; the result need not be closed.
    """
    low, side = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
    small_vertices, small_faces = vertices, faces
    for cells in GRIDS:
        if len(small_faces) <= max_faces:
            break
        cell = np.floor((vertices - low) / side * (cells - 1e-9)).astype(np.int64)
        _, cell_of, counts = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
        cell_of = cell_of.reshape(-1)
        sums = [np.bincount(cell_of, weights=vertices[:, axis]) for axis in range(3)]
        small_vertices = np.stack(sums, axis=1) / counts[:, None]
        merged = cell_of[faces]
        is_face = (merged != np.roll(merged, 1, axis=1)).all(axis=1)
        small_faces = np.unique(_rotated(merged[is_face]), axis=0)
    return small_vertices, small_faces


def _rotated(faces: Ints) -> Ints:
    """Triangles (m, 3) that begin with their lowest vertex."""
    first = faces.argmin(axis=1)
    return np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)


def _short(number: float) -> float:
    """A number with six significant digits."""
    return float(f"{number:.6g}")
