import numpy as np
import pytest

from cutgrammar.geometry.fragment import Cloud, Mesh
from cutgrammar.geometry.slicing import solid_of
from measures.stability import CHANGES, COARSE, coarser, finer, moved, renumbered, scanned, shifts


@pytest.fixture
def few(blocks):
    return blocks(3, seed=5)


@pytest.mark.parametrize("change", [moved, renumbered, finer])
def test_changes_of_representation_keep_the_volume(change, lump, rng):
    changed = change(lump, rng)
    assert changed.volume == pytest.approx(lump.volume, rel=1e-9)
    assert solid_of(changed).genus() == 0


def test_finer_and_coarser_meshes_describe_nearly_the_same_surface(lump, rng):
    fine = finer(lump, rng)
    assert len(fine.faces) == 4 * len(lump.faces)
    coarse = coarser(fine, rng)
    assert len(coarse.faces) < len(fine.faces)
    assert coarse.volume == pytest.approx(lump.volume, rel=6 * COARSE)


def test_a_scan_is_a_cloud_with_the_given_number_of_distinct_points(lump, rng):
    cloud = scanned(lump, rng, 100)
    assert isinstance(cloud, Cloud)
    assert len(np.unique(cloud.points, axis=0)) == 100
    assert np.linalg.norm(cloud.normals, axis=1) == pytest.approx(1.0)


def test_rigid_motion_changes_z_only_by_rounding(extractor, few, lump, rng):
    assert shifts(extractor, [lump], CHANGES["rigid motion"], rng).shape.max() < 1e-9
    found = shifts(extractor, few, CHANGES["rigid motion"], rng)
    assert found.shape_best_flip.max() < 1e-9  # boxes are symmetric under every flip
    assert found.scale.max() < 1e-9


@pytest.mark.parametrize("name", CHANGES)
def test_every_change_of_z_is_smaller_than_the_distance_between_fragments(extractor, few, rng, name):
    found = shifts(extractor, few, CHANGES[name], rng)
    assert found.before.shape == found.after.shape == (3, 17)
    assert (found.shape_best_flip <= found.shape).all()
    assert np.median(found.shape_best_flip) < 0.6


def test_an_unchanged_mesh_has_an_unchanged_z(extractor, few, rng):
    found = shifts(extractor, few, lambda features, mesh, _: features.flipped(Mesh(mesh.vertices, mesh.faces)), rng)
    assert found.shape.max() == found.scale.max() == 0.0
