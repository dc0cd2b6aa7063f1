import numpy as np
import pytest

from cutgrammar.plugins import FOODS, load, reference_of
from cutgrammar.seeds import stream
from cutgrammar.settings import CameraSettings, DemonstratorSettings, Settings
from cutgrammar.trials.setups import SETUPS
from cutgrammar_sim.demonstrator.demonstrate import make_demonstration
from cutgrammar_sim.worlds.scenes import make_scene, seen_scenes

SETTINGS = Settings(cameras=CameraSettings(renderer="rays", width=320, height=240))


@pytest.fixture(scope="module")
def demonstrations():
    foods = {name: load(reference_of(FOODS, name)) for name in ("carrot", "block")}
    return [
        make_demonstration(i, SETUPS["N1M1"], (category,), foods, 4, DemonstratorSettings())
        for i, category in enumerate(("slices", "cubes"))
    ]


@pytest.mark.parametrize("wanted", [1, 2, 9, 16])
def test_a_scene_has_the_requested_number_of_fragments_at_rest_on_the_board(demonstrations, wanted):
    scene = make_scene(demonstrations, SETTINGS, stream(1, "scene", wanted), wanted)
    assert len(scene) == wanted
    corners = np.concatenate([fragment.X_WF.apply(fragment.mesh.vertices) for fragment in scene])
    assert corners[:, 2].min() > -1e-3
    assert corners[:, 2].min() < 1e-3


def test_scenes_depend_only_on_their_number_and_the_seed(demonstrations):
    two, three = (seen_scenes(demonstrations, SETTINGS, 7, count) for count in (2, 3))
    for a, b in zip(two, three, strict=False):
        assert a.points.tobytes() == b.points.tobytes()
        assert np.array_equal(a.owners, b.owners)
    other = seen_scenes(demonstrations, SETTINGS, 8, 1)[0]
    assert not np.array_equal(other.points[:5], two[0].points[:5])
    assert len({len(np.unique(scene.owners)) for scene in three}) > 1


def test_scenes_need_demonstrations():
    with pytest.raises(ValueError, match="there are none"):
        make_scene([], SETTINGS, np.random.default_rng(0))
