import hashlib

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar.plugins import FOODS, load, reference_of
from cutgrammar.settings import WorldSettings
from cutgrammar_sim.physics.hulls import FILLED, MAX_PIECE_CORNERS, convex_parts, hull_pieces
from cutgrammar_sim.worlds.board import Board


def food(name, seed=0):
    return load(reference_of(FOODS, name))(np.random.default_rng(seed))


@pytest.mark.parametrize("name", ["carrot", "cucumber", "potato", "courgette", "block", "aubergine", "apple"])
def test_a_food_that_fills_its_hull_collides_as_its_hull(name):
    mesh = food(name)
    assert convex_parts(mesh) == (mesh,)


def test_a_banana_collides_by_parts_that_fill_it_and_its_hollow_stays_free():
    mesh = food("banana")
    assert mesh.volume < FILLED * ConvexHull(mesh.vertices).volume
    parts = convex_parts(mesh)
    assert sum(part.volume for part in parts) == pytest.approx(mesh.volume, rel=1e-9)
    assert sum(ConvexHull(part.vertices).volume for part in parts) < 1.05 * mesh.volume
    assert all(len(corners) <= MAX_PIECE_CORNERS for part in parts for corners in hull_pieces(part))


def test_the_parts_of_a_mesh_are_always_the_same():
    prints = {
        hashlib.sha256(b"".join(part.vertices.tobytes() for part in convex_parts(food("banana", 3)))).hexdigest()
        for _ in range(2)
    }
    assert len(prints) == 1


def test_something_small_stands_in_the_bend_of_a_banana():
    banana = food("banana")
    lying = Fragment(banana, Pose(np.eye(3), [0.0, 0.0, -banana.vertices[:, 2].min()]))
    hull = ConvexHull(banana.vertices)
    cube = Fragment(food("block").moved(Pose.identity()), Pose.identity())
    small = type(cube.mesh)(0.25 * cube.mesh.vertices, cube.mesh.faces)
    hollow = np.array([0.0, banana.vertices[:, 1].min() + 0.01, 0.0])
    assert (hull.equations[:, :3] @ hollow + hull.equations[:, 3] < 0).all()  # the hull would push it out
    world = Board(WorldSettings())
    world.reset((lying, Fragment(small, Pose(np.eye(3), [hollow[0], hollow[1], -small.vertices[:, 2].min()]))))
    assert np.linalg.norm(world.truth()[1].p_WC[:2] - hollow[:2]) < 1e-3
