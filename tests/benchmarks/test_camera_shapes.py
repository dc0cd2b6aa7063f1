import numpy as np
import pytest

from camera_shapes import apart, cut_in_place
from simple_shapes import box_fragment


def test_a_food_cut_in_place_has_the_asked_gap_and_keeps_its_volume(rng):
    bar = box_fragment((0.12, 0.03, 0.03), [0.02, 0.01, 0.015])
    parts = cut_in_place(bar, 2, rng)
    assert len(parts) == 3
    assert sum(mesh.volume for mesh, _ in parts) == pytest.approx(bar.mesh.volume)
    closed, open_ = apart(parts, 0.0), apart(parts, 0.002)
    assert all(np.allclose(f.X_WF.apply(f.mesh.vertices), m.vertices) for f, (m, _) in zip(closed, parts, strict=True))
    assert all(f.p_WC[2] == pytest.approx(m.centroid[2]) for f, (m, _) in zip(open_, parts, strict=True))
    lengths = [np.ptp(np.concatenate([f.X_WF.apply(f.mesh.vertices) for f in now])[:, 0]) for now in (closed, open_)]
    assert lengths[1] - lengths[0] == pytest.approx(0.004, abs=2e-4)
