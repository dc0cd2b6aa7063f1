import numpy as np
import pytest

from cutgrammar.geometry.canonical import canonical_frame, extents
from cutgrammar.geometry.partial_volume import height_of_volume, part_below, volume_below
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.slicing import slice_mesh


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("share", [0.03, 0.4, 0.9])
def test_the_part_below_is_the_product_of_the_cut(axis, share, lump):
    low, high = lump.vertices[:, axis].min(), lump.vertices[:, axis].max()
    height = low + share * (high - low)
    below = slice_mesh(lump, Plane(np.eye(3)[axis], -height)).below
    assert len(below) == 1
    part = part_below(lump.triangles, axis, height)
    lower, upper = extents(below[0], canonical_frame(below[0]))
    assert volume_below(lump.triangles, axis, height) == pytest.approx(below[0].volume, rel=1e-10)
    assert part.volume == pytest.approx(below[0].volume, rel=1e-10)
    assert part.extents == pytest.approx(upper - lower, rel=1e-9)
    assert height_of_volume(lump.triangles, axis, below[0].volume) == pytest.approx(height, abs=1e-10)


def test_all_of_a_solid_or_nothing_is_below(lump):
    assert volume_below(lump.triangles, 2, 1.0) == pytest.approx(lump.volume)
    assert volume_below(lump.triangles, 2, -1.0) == 0.0
    assert part_below(lump.triangles, 2, -1.0) is None
    whole = part_below(lump.triangles, 0, 1.0)
    low, high = extents(lump, canonical_frame(lump))
    assert whole.extents == pytest.approx(high - low)


def test_corners_in_the_plane_and_triangles_across_it_are_counted_once():
    from simple_shapes import box_mesh

    box = box_mesh(0.02, 0.04, 0.06)
    assert volume_below(box.triangles, 2, -0.03) == 0.0
    assert volume_below(box.triangles, 2, 0.03) == pytest.approx(box.volume)
    assert volume_below(box.triangles, 2, 0.0) == pytest.approx(box.volume / 2)
    assert part_below(box.triangles, 2, 0.0).extents == pytest.approx([0.02, 0.03, 0.04])
