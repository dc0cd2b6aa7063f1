"""Edges are sharp, gentle bends are smooth, and the surface does not move."""

import numpy as np
import trimesh

from cutgrammar.geometry.fragment import Mesh
from cutgrammar_dashboards.rendering.shading import split_at_creases


def test_splitting_at_creases_moves_no_triangle(lump):
    vertices, normals, faces, _ = split_at_creases(lump)
    assert np.array_equal(vertices[faces], lump.triangles)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)


def test_a_box_has_a_normal_for_each_side_of_every_corner():
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    vertices, normals, _, _ = split_at_creases(Mesh(box.vertices, box.faces))
    assert len(vertices) == 24
    assert np.allclose(np.abs(normals).max(axis=1), 1.0)


def test_a_ball_is_smooth_and_no_vertex_is_doubled():
    ball = trimesh.creation.icosphere(3, 0.05)
    vertices, normals, _, _ = split_at_creases(Mesh(ball.vertices, ball.faces))
    assert len(vertices) == len(ball.vertices)
    assert np.einsum("ij,ij->i", normals, vertices / 0.05).min() > 0.999


def test_faces_without_area_are_left_out():
    box = trimesh.creation.box((1, 1, 1))
    faces = np.vstack([box.faces, [[0, 1, 1]]])
    assert len(split_at_creases(Mesh(box.vertices, faces))[2]) == 12
