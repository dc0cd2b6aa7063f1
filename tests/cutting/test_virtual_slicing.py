"""Virtual products have the volume, spread and overlap of those that the exact slicer makes."""

import numpy as np
import pytest
import trimesh

from cutgrammar.cutting.virtual_slicing import body_of, union_of
from cutgrammar.geometry.canonical import canonical_frame, covariance
from cutgrammar.geometry.comparison.overlap import Solid, iou
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.geometry.slicing import slice_mesh


def box(*sides):
    made = trimesh.creation.box(sides)
    return Mesh(made.vertices, made.faces)


@pytest.fixture
def food(rng):
    made = trimesh.creation.icosphere(3, 0.03)
    return Mesh(made.vertices * np.array([1.0, 0.7, 2.0]) + 0.002 * made.vertices[:, ::-1], made.faces)


def random_planes(rng, n):
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.column_stack([normals, rng.uniform(-0.01, 0.01, size=n)])


def exact_products(mesh, plane):
    cut = slice_mesh(mesh.moved(canonical_frame(mesh).inverse()), Plane(plane[:3], plane[3]))
    above, below = sorted(cut.products, key=lambda m: plane[:3] @ m.centroid, reverse=True)
    return above, below


def test_a_body_holds_the_volume_of_its_mesh(food):
    assert body_of(food).volume == pytest.approx(food.volume, rel=1e-9)


def test_shares_and_spreads_are_those_of_the_exact_products(rng, food):
    body, planes = body_of(food), random_planes(rng, 12)
    shares, above, below = body.shares(planes), body.spreads(planes, True), body.spreads(planes, False)
    for i, plane in enumerate(planes):
        products = exact_products(food, plane)
        assert shares[i] == pytest.approx(products[0].volume / food.volume, abs=0.02)
        for spreads, product in zip((above[i], below[i]), products, strict=True):
            np.testing.assert_allclose(spreads, np.sqrt(np.linalg.eigvalsh(covariance(product))), rtol=0.08)


def test_offsets_leave_the_wanted_share(rng, food):
    body, normals = body_of(food), random_planes(rng, 8)[:, :3]
    wanted = rng.uniform(0.05, 0.95, size=8)
    planes = np.column_stack([normals, body.offsets_for(normals, wanted)])
    np.testing.assert_allclose(body.shares(planes), wanted, atol=1e-4)


def test_ious_follow_the_exact_ones(rng, food):
    body, planes = body_of(food), random_planes(rng, 12)
    goal = exact_products(food, np.array([0.0, 0.0, 1.0, 0.004]))[0]
    estimated = body.ious(planes, True, body_of(goal))
    exact = np.array([iou(Solid(exact_products(food, plane)[0]), Solid(goal)) for plane in planes])
    assert np.abs(estimated - exact).mean() < 0.08
    assert np.corrcoef(estimated, exact)[0, 1] > 0.95
    assert body.ious(np.array([[0.0, 0.0, 1.0, 0.004]]), True, body_of(goal))[0] > 0.85


def test_fragments_in_place_make_one_body_again(food):
    halves = [Fragment(mesh, Pose(np.eye(3), np.zeros(3))) for mesh in exact_products(food, np.array([0, 1.0, 0, 0]))]
    union, whole = union_of(halves), body_of(food)
    assert union.volume == pytest.approx(whole.volume, rel=1e-6)
    np.testing.assert_allclose(union.sizes, whole.sizes, rtol=1e-6)


def test_a_cloud_counts_as_its_convex_hull():
    body = body_of(sample_surface(box(0.03, 0.04, 0.06), 2048))
    assert body.volume == pytest.approx(0.03 * 0.04 * 0.06, rel=0.05)
