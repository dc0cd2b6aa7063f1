import numpy as np
import pytest

from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.geometry.slicing import slice_mesh
from cutgrammar.interfaces import Refusal, Stuck
from cutgrammar.methods.halving import SHARES, HalvePlanner
from cutgrammar.seeds import stream
from simple_shapes import box_fragment

LONG = box_fragment([0.02, 0.12, 0.03], [0.0, 0.0, 0.01], heading=0.7)
THICK = box_fragment([0.08, 0.07, 0.09], [0.3, 0.0, 0.05])


def cuts(now, n):
    """The cuts proposed while all before them are refused."""
    found = []
    for attempt in range(n):
        found.append(HalvePlanner().next_cut(now, (), [Refusal(cut, "no") for cut in found], stream(attempt)))
    return found


@pytest.mark.parametrize("now", [(LONG, THICK), (THICK, LONG)])
def test_the_longest_fragment_is_halved_across_its_long_axis_though_another_is_larger(now):
    (cut,) = cuts(now, 1)
    assert np.array_equal(cut.p_WC[0], LONG.p_WC)
    assert abs(cut.plane_W.normal @ LONG.X_WF.rotation[:, 1]) == pytest.approx(1.0)
    assert float(cut.plane_W.distances(LONG.p_WC)) == pytest.approx(0.0, abs=1e-12)


def test_the_plane_halves_the_length_not_the_volume(lump):
    plane = HalvePlanner().next_cut((Fragment(lump, LONG.X_WF),), (), [], stream(0)).plane_W
    heights = plane.distances(LONG.X_WF.apply(lump.vertices))
    assert heights.max() == pytest.approx(-heights.min())
    sliced = slice_mesh(Fragment(lump, LONG.X_WF).mesh.moved(LONG.X_WF), plane)
    assert abs(sliced.above[0].volume / lump.volume - 0.5) > 1e-4


def test_the_long_axis_is_that_of_the_largest_extent_though_another_has_more_variance():
    needle = np.array([[0, 0, 0.031], [0.0002, 0, 0.031], [0, 0.0002, 0.031]])
    wide = box_fragment([0.05, 0.005, 0.03], [0, 0, 0]).mesh
    tall = Fragment(type(wide)(np.vstack([wide.vertices, needle]), wide.faces), LONG.X_WF)  # vertices off the surface
    (cut,) = cuts((tall,), 1)
    heights = cut.plane_W.distances(tall.X_WF.apply(tall.mesh.vertices))
    assert np.ptp(heights) == pytest.approx(np.ptp(tall.mesh.vertices, axis=0).max(), rel=0.05)


def test_after_a_refusal_comes_the_next_longest_fragment_and_then_another_position():
    first, second, third = cuts((LONG, THICK), 3)
    assert np.array_equal(second.p_WC[0], THICK.p_WC)
    assert np.array_equal(third.p_WC[0], LONG.p_WC)
    shift = float(third.plane_W.distances(LONG.p_WC)) - float(first.plane_W.distances(LONG.p_WC))
    assert abs(shift) == pytest.approx(0.12 * 0.05)


def test_halve_is_stuck_when_every_position_was_refused():
    *found, last = cuts((LONG,), len(SHARES) + 1)
    assert len({cut.plane_W.offset for cut in found}) == len(SHARES)
    assert last == Stuck(f"all {len(SHARES)} positions across the 1 fragments were refused")


def test_a_cloud_is_halved_like_its_mesh():
    cloud = Fragment(sample_surface(LONG.mesh, 2000), LONG.X_WF)
    (cut,) = cuts((cloud,), 1)
    assert abs(cut.plane_W.normal @ LONG.X_WF.rotation[:, 1]) == pytest.approx(1.0, abs=1e-3)
    assert float(cut.plane_W.distances(LONG.p_WC)) == pytest.approx(0.0, abs=1e-3)
