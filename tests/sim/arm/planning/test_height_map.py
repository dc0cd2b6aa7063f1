import numpy as np
import pytest
from scipy.spatial import ConvexHull, cKDTree
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.planning.height_map import CELL, SPACING, Heights, stamp_of, surface_points


def lying(lump, rng, count=3):
    found = []
    for k in range(count):
        rotation = Rotation.random(rng=rng).as_matrix()
        low = (lump.vertices @ rotation.T)[:, 2].min()
        found.append(Fragment(lump, Pose(rotation, [0.09 * k - 0.1, rng.uniform(-0.1, 0.1), -low])))
    return tuple(found)


def test_a_ball_that_clears_the_map_touches_no_fragment(lump, rng):
    fragments = lying(lump, rng)
    heights = Heights(map(stamp_of, fragments))
    corners = np.concatenate([f.X_WF.apply(surface_points(lump)) for f in fragments])
    for radius in (0.0, 0.004, 0.01, 0.02, 0.046):
        middles = rng.uniform([-0.2, -0.2, 0.0], [0.2, 0.2, 0.16], (400, 3))
        room = heights.room(middles, radius)
        apart, _ = cKDTree(corners).query(middles)
        assert (room < 0.0).any()
        assert (room > 0.0).any()
        assert (apart[room >= 0.0] > radius - 1e-9).all()
        inside = np.zeros(len(middles), dtype=bool)
        for f in fragments:
            planes = ConvexHull(f.X_WF.apply(lump.vertices)).equations
            inside |= (middles @ planes[:, :3].T + planes[:, 3] < 0.0).all(axis=1)
        assert (room[inside] < 0.0).all()


def test_a_map_errs_by_little_more_than_a_cell(lump, rng):
    fragments = lying(lump, rng, 1)
    heights = Heights(map(stamp_of, fragments))
    top = fragments[0].X_WF.apply(lump.vertices)
    highest = top[np.argmax(top[:, 2])]
    for radius in (0.0, 0.01, 0.02):
        assert -1e-12 <= -heights.room(highest + np.array([0.0, 0.0, radius]), radius) < 0.5e-3
        beside = np.array([top[:, 0].max() + radius + 3.0 * CELL, highest[1], radius])
        assert heights.room(beside, radius) == pytest.approx(0.0, abs=1e-12)


def test_far_away_there_is_nothing_but_the_board(lump, rng):
    heights = Heights(map(stamp_of, lying(lump, rng)))
    assert heights.room(np.array([2.0, -3.0, 0.05]), 0.02) == pytest.approx(0.03)
    bare = Heights([])
    assert bare.tallest == 0.0
    assert bare.room(np.array([0.0, 0.0, 0.05]), 0.02) == pytest.approx(0.03)


def test_the_points_of_a_surface_lie_on_the_hull_and_leave_no_hole(lump, rng):
    points = surface_points(lump)
    hull = ConvexHull(lump.vertices)
    assert np.abs((points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)).max() < 1e-9
    triangles = lump.vertices[hull.simplices]
    weights = rng.dirichlet([1.0, 1.0, 1.0], (len(triangles), 2))
    anywhere = np.einsum("tkc,tcx->tkx", weights, triangles).reshape(-1, 3)
    assert cKDTree(points).query(anywhere)[0].max() < SPACING
