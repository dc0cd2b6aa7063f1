import itertools

import numpy as np
import pytest

from cutgrammar.geometry.canonical import FLIPS
from cutgrammar.geometry.comparison.overlap import Solid, best_match, bounds, iou
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.slicing import slice_mesh
from simple_shapes import box_mesh


@pytest.fixture
def fragments(lump, rng):
    found = [lump]
    for _ in range(6):
        largest = max(range(len(found)), key=lambda i: found[i].volume)
        cut = slice_mesh(found[largest], Plane.through(found[largest].centroid, rng.normal(size=3)))
        found[largest : largest + 1] = cut.products
    return found


def test_a_remeshed_moved_and_shuffled_copy_matches_with_iou_1(fragments, random_pose, remeshed, rng):
    copies = [remeshed(mesh, random_pose()) for mesh in fragments]
    order = rng.permutation(len(copies))
    matching = best_match([Solid(copies[i]) for i in order], [Solid(mesh) for mesh in fragments])
    assert matching.strict == pytest.approx(1.0, abs=1e-9)
    assert list(matching.goal) == list(order)


def test_matching_with_bounds_equals_matching_of_all_pairs(fragments):
    solids = [Solid(mesh) for mesh in fragments]
    few, many = solids[:3], solids[2:]
    table = np.array([[iou(a, b) for b in many] for a in few])
    best = max(sum(table[i, j] for i, j in enumerate(order)) for order in itertools.permutations(range(len(many)), 3))
    matching = best_match(few, many)
    assert matching.ious.sum() == pytest.approx(best, abs=1e-12)
    assert matching.strict == pytest.approx(best / len(many), abs=1e-12)
    assert matching.mean == pytest.approx(best / 3, abs=1e-12)


def test_bounds_are_at_least_the_iou(fragments):
    solids = [Solid(mesh) for mesh in fragments]
    limits = bounds(solids, solids)
    for i, j in itertools.product(range(len(solids)), repeat=2):
        for flip, limit in zip(FLIPS, limits[i, j], strict=True):
            exact = solids[i].iou_with(solids[j], flip.rotation)
            assert exact - 1e-12 <= limit <= exact + 0.1


def test_iou_is_symmetric_and_exact_for_boxes():
    a, b = Solid(box_mesh(0.1, 0.2, 0.3)), Solid(box_mesh(0.1, 0.2, 0.4))
    assert iou(a, b) == pytest.approx(0.75, abs=1e-12)
    assert iou(b, a) == pytest.approx(0.75, abs=1e-12)


def test_missing_fragments_lower_the_strict_score(fragments):
    solids = [Solid(mesh) for mesh in fragments]
    matching = best_match(solids[:1], solids)
    assert matching.mean == pytest.approx(1.0, abs=1e-9)
    assert matching.strict == pytest.approx(1 / len(solids), abs=1e-9)


def test_an_empty_configuration_is_refused(fragments):
    with pytest.raises(ValueError, match="without fragments"):
        best_match([], [Solid(fragments[0])])
