"""Fragments keep their names as long as they keep their shapes."""

import numpy as np

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar_dashboards.recording.fragment_names import followed, shape_digest


def test_a_moved_copy_keeps_its_name_and_new_shapes_get_new_ones(lump, random_pose):
    other = Mesh(lump.vertices * 0.5, lump.faces)
    before = followed({}, (Fragment(lump, random_pose()), Fragment(other, random_pose())), 0)
    copy = Mesh(lump.vertices.copy(), lump.faces.copy())
    piece = Mesh(lump.vertices * 0.25, lump.faces)
    after = followed(before, (Fragment(piece, random_pose()), Fragment(copy, random_pose())), 2)
    assert list(before) == [0, 1]
    assert list(after) == [2, 0]


def test_fragments_of_one_shape_are_distinguished_by_position(lump):
    def at(x):
        return Fragment(lump, Pose(np.eye(3), np.array([x, 0.0, 0.0])))

    before = followed({}, (at(0.0), at(1.0)), 0)
    assert list(followed(before, (at(1.01), at(0.01)), 2)) == [1, 0]
    assert list(followed(before, (at(0.0), at(1.0), at(2.0)), 2)) == [0, 1, 2]


def test_the_digest_of_a_shape_does_not_depend_on_its_pose(lump, random_pose):
    assert shape_digest(Fragment(lump, random_pose())) == shape_digest(Fragment(lump, random_pose()))
