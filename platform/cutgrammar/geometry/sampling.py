"""Evenly distributed surface points with normals, from a low-discrepancy sequence: a pure function of the shape."""

from functools import lru_cache

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Cloud, Mesh


def sample_surface(mesh: Mesh, count: int) -> Cloud:
    """Sample `count` surface points uniformly by area, with the normals of their triangles, in the mesh's frame F.

    The sampling is deterministic: the same mesh gives the same points. Triangles without area get no points.
    """
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    crosses = np.cross(b - a, c - a)
    doubled = np.linalg.norm(crosses, axis=1)
    bounds = np.cumsum(doubled)
    u = _unit_cube(count)
    # The sorted positions along the cumulative area give each triangle its share to within one point.
    chosen = np.searchsorted(bounds, (np.arange(count) + 0.5) / count * bounds[-1], side="right")
    chosen = np.minimum(chosen, len(bounds) - 1)
    root = np.sqrt(u[:, :1])
    points = (1 - root) * a[chosen] + root * (1 - u[:, 1:]) * b[chosen] + root * u[:, 1:] * c[chosen]
    return Cloud(points, crosses[chosen] / doubled[chosen, None])


def cloud_of(shape: Mesh | Cloud, count: int) -> Cloud:
    """`count` surface points: sampled from a mesh, or every n-th point of a cloud (repeated if it has fewer)."""
    if isinstance(shape, Mesh):
        return sample_surface(shape, count)
    chosen = (np.arange(count) * len(shape.points)) // count
    return Cloud(shape.points[chosen], shape.normals[chosen])


@lru_cache(maxsize=8)
def _unit_cube(count: int) -> Floats:
    from scipy.stats import qmc  # takes half a second to import, which those who watch a run do not need

    return np.asarray(qmc.Halton(2, scramble=False).random(count + 1)[1:])
