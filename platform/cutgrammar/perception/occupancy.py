"""Point-in-mesh tests by the generalized winding number (Jacobson et al. 2013).

The solid angles that the triangles subtend at a point sum to 4 pi inside and to 0 outside. No normals are used, and
sliver triangles contribute almost nothing, so triangles without area, which cuts may leave, are harmless.
"""

import numba
import numpy as np
from numpy.typing import NDArray

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Mesh


def inside(mesh: Mesh, points: Floats) -> NDArray[np.bool_]:
    """(n,) whether the mesh encloses each of `points` (n, 3), in the mesh's frame F [m]."""
    return np.asarray(winding_numbers(mesh, points) > 0.5)


def winding_numbers(mesh: Mesh, points: Floats) -> Floats:
    """(n,) winding number of the mesh about each of `points` (n, 3): 1 inside and 0 outside, up to rounding."""
    return np.asarray(_winding_numbers(mesh.triangles, np.ascontiguousarray(points, dtype=np.float64)))


@numba.njit(cache=True)  # type: ignore[misc, unused-ignore]
def _winding_numbers(triangles: Floats, points: Floats) -> Floats:
    result = np.empty(len(points))
    for i in range(len(points)):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        total = 0.0
        for t in range(len(triangles)):
            ax, ay, az = triangles[t, 0, 0] - px, triangles[t, 0, 1] - py, triangles[t, 0, 2] - pz
            bx, by, bz = triangles[t, 1, 0] - px, triangles[t, 1, 1] - py, triangles[t, 1, 2] - pz
            cx, cy, cz = triangles[t, 2, 0] - px, triangles[t, 2, 1] - py, triangles[t, 2, 2] - pz
            a = np.sqrt(ax * ax + ay * ay + az * az)
            b = np.sqrt(bx * bx + by * by + bz * bz)
            c = np.sqrt(cx * cx + cy * cy + cz * cz)
            # tan of half the solid angle is numerator / denominator (Van Oosterom and Strackee 1983)
            numerator = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
            denominator = (
                a * b * c
                + (ax * bx + ay * by + az * bz) * c
                + (bx * cx + by * cy + bz * cz) * a
                + (cx * ax + cy * ay + cz * az) * b
            )
            total += np.arctan2(numerator, denominator)
        result[i] = total / (2.0 * np.pi)
    return result
