import numpy as np
from scipy.spatial import ConvexHull, cKDTree

from cutgrammar_sim.physics.convex_hull import SPACING, hull_of, surface_points


def test_the_corners_triangles_and_planes_of_a_hull_fit_together(lump):
    corners, triangles, planes = hull_of(lump)
    inside = corners @ planes[:, :3].T + planes[:, 3]
    assert inside.max() < 1e-9
    on_plane = np.abs(np.take_along_axis(inside.T, triangles, axis=1))
    assert on_plane.max() < 1e-9


def test_the_points_of_a_surface_lie_on_the_hull_and_leave_no_hole(lump, rng):
    points = surface_points(lump)
    hull = ConvexHull(lump.vertices)
    assert np.abs((points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)).max() < 1e-9
    triangles = lump.vertices[hull.simplices]
    weights = rng.dirichlet([1.0, 1.0, 1.0], (len(triangles), 2))
    anywhere = np.einsum("tkc,tcx->tkx", weights, triangles).reshape(-1, 3)
    assert cKDTree(points).query(anywhere)[0].max() < SPACING
