import os
import subprocess
import sys

import numpy as np
import pytest

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Cut, Done
from cutgrammar.seeds import stream
from cutgrammar.settings import CameraSettings, Settings
from cutgrammar_sim.cameras.camera import BACKGROUND, two_cameras
from cutgrammar_sim.cameras.look import look
from cutgrammar_sim.cameras.rays import Rays
from cutgrammar_sim.cameras.renderers import renderer
from cutgrammar_sim.cameras.vulkan import NoVulkanError, Vulkan
from cutgrammar_sim.foods import carrot
from cutgrammar_sim.worlds import board
from cutgrammar_sim.worlds import kinova as arm

WITHOUT_VULKAN = """
import sys
import numpy as np
from cutgrammar.errors import InputError
from cutgrammar.seeds import stream
from cutgrammar.settings import CameraSettings
from cutgrammar_sim.cameras.look import look
from cutgrammar_sim.cameras.renderers import renderer
from cutgrammar_sim.foods import carrot
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.pose import Pose
mesh = carrot(stream(0))
now = (Fragment(mesh, Pose(np.eye(3), [0, 0, -mesh.vertices[:, 2].min()])),)
settings = CameraSettings(width=160, height=120)
for again in range(2):
    assert len(look(now, settings, stream(0)).points) > 100
print(renderer("auto").name)
try:
    renderer("vulkan")
except InputError as error:
    print(error)
"""


@pytest.fixture
def vulkan():
    try:
        return Vulkan()
    except NoVulkanError as error:
        pytest.skip(f"no Vulkan device: {error}")


def carrots(count=3):
    meshes = [carrot(stream(0, i)) for i in range(count)]
    return tuple(
        Fragment(mesh, Pose(np.eye(3), [0.0, 0.06 * (i - 1), -mesh.vertices[:, 2].min()]))
        for i, mesh in enumerate(meshes)
    )


def test_both_renderers_give_the_same_depth_and_the_same_owners(vulkan):
    now = carrots()
    link = Mesh(now[0].mesh.vertices + np.array([0.0, 0.0, 0.1]), now[0].mesh.faces)
    cameras = two_cameras(CameraSettings(width=320, height=240))
    for first, second in zip(vulkan.images(cameras, now, [link]), Rays().images(cameras, now, [link]), strict=True):
        shown = (first.owner != BACKGROUND) | (second.owner != BACKGROUND)
        same = first.owner == second.owner
        assert set(np.unique(first.owner)) == set(np.unique(second.owner)) == {-2, -1, 0, 1, 2}
        assert same[shown].mean() > 0.99
        assert np.median(np.abs(first.depth - second.depth)[shown & same]) < 2e-4
        assert np.array_equal(first.depth[~shown], second.depth[~shown])


def test_an_empty_board_is_seen_by_both_renderers(vulkan):
    cameras = two_cameras(CameraSettings(width=64, height=48))
    for render in (vulkan, Rays()):
        for image in render.images(cameras, ()):
            assert (image.owner == BACKGROUND).all()
            assert (image.depth > 0.0).all()


@pytest.mark.parametrize("make", [pytest.param(board.make_world), pytest.param(arm.make_world, marks=pytest.mark.slow)])
def test_looking_changes_nothing_in_the_world(vulkan, make):
    def poses(watch):
        world = make(Settings(), lambda *names: stream(0, *names))
        world.reset(carrots())
        for normal in (np.array([0.96, 0.28, 0.0]), np.array([0.96, 0.0, 0.28])):
            watch(world.truth())
            p_WC = world.truth()[0].p_WC
            result = world.apply(Cut(Plane(normal, -normal @ p_WC), p_WC[None]))
            assert isinstance(result, Done)
        return np.array([fragment.X_WF.to_vector() for fragment in world.truth()])

    def looks(now):
        for render in (vulkan, Rays()):
            look(now, CameraSettings(width=64, height=48), stream(0), render=render)

    assert np.array_equal(poses(lambda now: None), poses(looks))


def test_auto_chooses_vulkan_if_there_is_a_device_and_prints_that_once(vulkan, caplog):
    renderer.cache_clear()
    assert renderer("auto").name == renderer("auto").name == "vulkan"
    assert caplog.messages == ["cameras: depth images are rendered with Vulkan"]
    assert renderer("rays").name == "rays"
    assert len(caplog.messages) == 1


def test_without_a_vulkan_device_auto_casts_rays_and_prints_that_once():
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_VULKAN],
        env=os.environ | {"VK_ICD_FILENAMES": "/nowhere.json", "VK_DRIVER_FILES": "/nowhere.json"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    backend, refused = done.stdout.splitlines()
    assert backend == "rays"
    assert refused.startswith("renderer 'vulkan' cannot be used: ")
    assert "apt-get install chromium" in refused
    assert done.stderr == "cameras: no Vulkan device here, so depth images are made by casting rays\n"


def test_another_renderer_is_an_input_error():
    with pytest.raises(InputError, match="renderer 'opengl' is unknown; known: auto, vulkan, rays"):
        renderer("opengl")
