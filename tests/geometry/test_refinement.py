import itertools

import numpy as np
import pytest
import trimesh
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.canonical import FLIPS
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.overlap import Solid, iou
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.refinement import reaches, refined_iou
from cutgrammar.geometry.slicing import slice_mesh


def box(*size):
    shape = trimesh.creation.box(size)
    return Mesh(shape.vertices, shape.faces)


def near_cube(rng, tilt_deg=2.0, size=(1.0, 1.0, 1.0)):
    """A cube, three sides of which were cut anew, each a little off square."""
    mesh = box(*np.multiply(size, 0.05))
    for axis in range(3):
        normal = np.eye(3)[axis] + np.tan(np.radians(tilt_deg)) * rng.normal(size=3)
        at = np.eye(3)[axis] * 0.02 * size[axis]
        mesh = max(slice_mesh(mesh, Plane.through(at, normal)).products, key=lambda product: product.volume)
    return Solid(mesh)


def test_near_cubes_whose_axes_are_noise_are_found_alike(rng):
    cubes = [near_cube(rng) for _ in range(6)]
    pairs = list(itertools.pairwise(cubes))
    plain = np.array([iou(a, b) for a, b in pairs])
    refined = np.array([refined_iou(a, b, p) for (a, b), p in zip(pairs, plain, strict=True)])
    assert plain.mean() < 0.85
    assert refined.min() > 0.88


def test_the_refined_iou_is_never_under_the_plain_one(rng):
    solids = [near_cube(rng, 8.0, rng.uniform(0.5, 1.5, 3)) for _ in range(6)]
    for a in solids:
        for b in solids:
            plain = iou(a, b)
            assert plain <= refined_iou(a, b, plain) <= 1.0 + 1e-9


def test_it_is_the_exact_iou_of_some_rotation_and_that_of_boxes_is_known():
    a, b = Solid(box(0.03, 0.04, 0.06)), Solid(box(0.03, 0.04, 0.05))
    assert refined_iou(a, b, iou(a, b)) == pytest.approx(5 / 6, abs=1e-9)


def test_pose_and_triangles_change_nothing_beyond_what_the_search_resolves(rng, random_pose, remeshed, lump):
    other = Mesh(lump.vertices * [1.0, 1.2, 0.8] + 0.002 * np.cos(60 * lump.vertices[:, [2, 0, 1]]), lump.faces)
    a, b = Solid(lump), Solid(other)
    here = refined_iou(a, b, iou(a, b))
    for _ in range(3):
        moved = [Solid(remeshed(mesh, random_pose())) for mesh in (lump, other)]
        assert refined_iou(*moved, iou(*moved)) == pytest.approx(here, abs=1e-6)


def test_the_same_meshes_give_the_same_bits(rng, lump):
    cube = near_cube(rng).mesh
    assert refined_iou(Solid(cube), Solid(lump), 0.0) == refined_iou(Solid(cube), Solid(lump), 0.0)


def test_a_solid_turned_within_its_frame_is_found_again(lump):
    a, b = Solid(lump), Solid(lump)
    turned = Rotation.from_rotvec([0.2, -0.1, 0.15]).as_matrix()
    b.mesh = Mesh(a.mesh.vertices @ turned.T, a.mesh.faces)
    b.reach = np.abs(b.mesh.vertices).max(axis=0)
    assert a.iou_with(b, np.eye(3)) < 0.95
    assert refined_iou(a, b, 0.0) > 0.98


def test_a_mesh_reaches_to_its_walls_and_beyond_a_gap_as_far_as_its_cone_is_full(lump):
    solid = box(2.0, 2.0, 2.0)
    directions = np.array([[1.0, 0.0, 0.0], [0.5, 0.5, 0.5], [0.0, -4.0, 2.0], [1.0, 1.0, 0.0]])
    assert reaches(solid.triangles, directions) == pytest.approx([1.0, 2.0, 0.25, 1.0], rel=1e-5)
    beyond = box(1.0, 1.0, 1.0).vertices + np.array([3.5, 0.0, 0.0])
    both = np.concatenate([solid.triangles, beyond[solid.faces]])
    assert reaches(both, directions[:1]) == pytest.approx([np.cbrt(1.0 + 4.0**3 - 3.0**3)], rel=1e-5)
    normals = np.random.default_rng(1).normal(size=(4000, 3))
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    about = Solid(lump).mesh
    assert 4 * np.pi / 3 * np.mean(reaches(about.triangles, unit) ** 3) == pytest.approx(about.volume, rel=0.03)


def by_exact_volumes(a, b):
    """The best IoU that Nelder and Mead's simplex finds from the four flips, led by booleans."""

    def found(flip):
        return minimize(
            lambda turn: -a.iou_with(b, Rotation.from_rotvec(turn).as_matrix() @ flip.rotation),
            np.zeros(3),
            method="Nelder-Mead",
            options={"initial_simplex": np.vstack([np.zeros(3), 0.2 * np.eye(3)]), "maxfev": 60},
        )

    return max(-found(flip).fun for flip in FLIPS)


def test_compass_search_comes_near_what_a_search_by_exact_volumes_finds(rng):
    for _ in range(3):
        a, b = near_cube(rng, 4.0), near_cube(rng, 4.0)
        assert refined_iou(a, b, iou(a, b)) > by_exact_volumes(a, b) - 0.015
