from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cutgrammar.errors import InputError
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Cut, Done, Refused, SeesWithCameras
from cutgrammar.motion import Motion, Phase
from cutgrammar.nn.mlp import MLP
from cutgrammar.perception.vision.neighbourhoods import EDGE_FEATURES, POINT_FEATURES
from cutgrammar.perception.vision.segmentation import Segmentation
from cutgrammar.plugins import WORLDS, load, reference_of
from cutgrammar.seeds import stream
from cutgrammar.settings import CameraSettings, Settings, VisionSettings
from cutgrammar_sim.worlds.perceived import known_cut, make_perceiving, scanned_goal
from simple_shapes import box_fragment

SETTINGS = Settings(cameras=CameraSettings(renderer="rays", width=320, height=240))


def bar(x=0.0, y=0.0, size=(0.08, 0.03, 0.03)):
    return box_fragment(size, [x, y, size[2] / 2])


def across(fragment, shift=0.0):
    point = fragment.p_WC + np.array([shift, 0.0, 0.0])
    return Cut(Plane.through(point, np.array([1.0, 0.0, 0.0])), fragment.p_WC[None])


@pytest.fixture(scope="module")
def joining():
    """A segmentation that joins neighbouring points."""
    describing = MLP((np.zeros((POINT_FEATURES, 1)),), (np.zeros(1),))
    return Segmentation(describing, (), MLP((np.zeros((2 + EDGE_FEATURES, 1)),), (np.full(1, 9.0),)), 0.5)


@pytest.fixture
def seen(joining):
    """Make a world of this name seen through cameras."""

    def make(name, settings=SETTINGS, trial=0):
        def streams(*names):
            return stream(0, trial, *names)

        world = load(reference_of(WORLDS, name))(settings, streams)
        return make_perceiving(world, SimpleNamespace(segmentation=joining), settings, streams)

    return make


@pytest.mark.parametrize("name", ["bench", "board", pytest.param("kinova", marks=pytest.mark.slow)])
def test_a_cut_of_a_perceived_fragment_leaves_two_perceived_fragments(seen, name):
    world = seen(name)
    world.reset((bar(), bar(0.0, 0.1, (0.05, 0.04, 0.02))))
    now = world.observe()
    assert len(now) == 2
    longest = max(now, key=lambda f: np.ptp(f.mesh.vertices, axis=0)[0])
    assert longest.p_WC == pytest.approx([0.0, 0.0, 0.015], abs=4e-3)
    assert isinstance(world.apply(across(longest, 0.01)), Done)
    now, truth = world.observe(), world.truth()
    assert len(now) == len(truth) == 3
    for fragment in truth:
        nearest = min(now, key=lambda f: np.linalg.norm(f.p_WC - fragment.p_WC))
        assert np.linalg.norm(nearest.p_WC - fragment.p_WC) < 5e-3
        assert nearest.mesh.volume == pytest.approx(fragment.mesh.volume, rel=0.35)
    event = world.sighted(2)
    assert isinstance(world, SeesWithCameras)
    assert len(event.points) == len(event.labels) == len(event.owners)
    assert event.configuration is now
    assert set(event.labels.tolist()) - {-1} == {0, 1, 2}


def test_without_belief_a_closed_seam_is_not_seen(seen):
    world = seen("bench", replace(SETTINGS, vision=VisionSettings(belief=False)))
    world.reset((bar(),))
    assert isinstance(world.apply(across(world.observe()[0])), Done)
    assert len(world.observe()) == 1
    assert len(world.truth()) == 2


def test_the_cameras_look_once_a_step_even_if_cuts_are_refused(seen):
    world = seen("bench")
    world.reset((bar(),))
    now = world.observe()
    assert isinstance(world.apply(across(now[0], 1.0)), Refused)
    assert world.observe() is now
    assert isinstance(world.apply(across(now[0])), Done)
    assert world.observe() is not now


def test_the_same_trial_has_the_same_noise_and_another_trial_other_noise(seen):
    def volumes(trial):
        world = seen("bench", trial=trial)
        world.reset((bar(),))
        world.observe()
        assert isinstance(world.apply(across(world.observe()[0])), Done)
        return [fragment.mesh.volume for fragment in world.observe()]

    assert volumes(0) == volumes(0)
    assert volumes(0) != volumes(1)


def test_a_model_without_segmentation_says_how_to_get_one():
    with pytest.raises(InputError, match="train one with --vision"):
        make_perceiving(None, SimpleNamespace(segmentation=None), SETTINGS, None)


def test_a_goal_is_known_from_clouds_of_whole_surfaces():
    goal = (bar(), bar(0.0, 0.1, (0.05, 0.04, 0.02)))
    scanned = scanned_goal(goal)
    for fragment, cloud in zip(goal, scanned, strict=True):
        assert len(cloud.mesh.vertices) > len(fragment.mesh.vertices)
        assert cloud.mesh.volume == pytest.approx(fragment.mesh.volume, rel=0.02)
        assert cloud.p_WC == pytest.approx(fragment.p_WC, abs=1e-3)
    again = scanned_goal(goal)
    assert all(np.array_equal(a.mesh.vertices, b.mesh.vertices) for a, b in zip(scanned, again, strict=True))


def motion_of(names, poses):
    """A motion of two samples a phase, of which only the poses of the blade matter."""
    times = np.arange(2.0 * len(names))
    nothing = np.zeros((len(times), 1))
    phases = tuple(Phase(name, 2 * i, ()) for i, name in enumerate(names))
    X_WB = np.repeat([pose.to_vector() for pose in poses], 2, axis=0)
    limits = np.array([[-1.0, 1.0]]), np.ones(1), np.ones(1)
    return Motion(
        times,
        ("a",),
        nothing,
        nothing,
        nothing,
        *limits,
        np.zeros((len(times), 6)),
        nothing[:, 0],
        (),
        nothing,
        X_WB,
        phases,
    )


TIPS = np.array([0.0, 0.0, -0.01])


def test_the_known_cut_of_an_arm_comes_from_its_blade_and_its_gripper():
    turned = Pose(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0.1, 0.05, 0.0]))
    start = Pose(np.eye(3), np.array([0.0, 0.0, 0.03]))
    names = ("transit", "pick", "carry", "place", "retreat", "approach", "press", "retreat", "settle")
    poses = [start, start, start, turned @ start, start, start, turned, start, start]
    known = known_cut(across(bar()), (bar(0.0, 0.2), bar()), motion_of(names, poses), TIPS)
    assert known.fragments == (1,)
    assert np.allclose(known.plane_W.to_vector(), [0.0, 1.0, 0.0, -0.05])
    ((index, X_move),) = known.moves
    assert index == 1
    assert np.allclose(X_move.to_vector(), turned.to_vector())
    stayed = known_cut(
        across(bar()), (bar(),), motion_of(("approach", "press", "retreat"), [start, turned, start]), TIPS
    )
    assert stayed.moves == ()
    planned = known_cut(across(bar()), (bar(),), None, TIPS)
    assert np.allclose(planned.plane_W.to_vector(), [1.0, 0.0, 0.0, 0.0])


def test_what_an_arm_set_aside_is_known_by_where_its_gripper_was():
    over = {name: Pose(np.eye(3), np.array([0.0, y, 0.03])) for name, y in (("cut", 0.0), ("other", 0.1), ("to", 0.2))}
    carry = ("transit", "pick", "carry", "place", "retreat")
    names = (*carry, *carry, "transit", "approach", "press", "retreat", "transit", "settle")
    there = [over["other"], over["other"], over["to"], over["to"], over["to"]]
    back = [over["cut"], over["cut"], over["other"], over["other"], over["other"]]
    poses = [*there, *back, *[over["other"]] * 6]
    known = known_cut(across(bar()), (bar(0.0, 0.1), bar(), bar(0.1, 0.1)), motion_of(names, poses), TIPS)
    assert known.fragments == (1,)
    assert [index for index, _ in known.moves] == [0, 1]
    assert np.allclose([X.position for _, X in known.moves], [[0.0, 0.1, 0.0], [0.0, 0.1, 0.0]])
