from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import slice_mesh
from cutgrammar.interfaces import Refused
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.planning.cut_plan import CutPlan, plan_cut
from cutgrammar_sim.arm.planning.rig import rig_of
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.tool import knife
from cutgrammar_sim.arm.robot.urdf import read_urdf
from simple_shapes import box_fragment as box

X, Y, Z = np.eye(3)
SETTINGS = Settings()
RIG = rig_of(gen3(), knife(SETTINGS), SETTINGS)
HOME = RIG.arm.home
FORCE = 30.0


@pytest.fixture(scope="module")
def planned(check_plan):
    def plan_and_check(now, meant, plane, rig=RIG, q_now=None):
        q_now = rig.arm.home if q_now is None else q_now
        plan = plan_cut(now, meant, plane, rig, q_now, FORCE)
        assert isinstance(plan, CutPlan), plan
        check_plan(plan, now, plane, rig, q_now)
        return plan

    return plan_and_check


def test_a_steep_plane_is_pressed_where_the_fragment_lies(planned, rng):
    for _ in range(4):
        fragment = box((0.1, 0.05, 0.04), [*rng.uniform(-0.05, 0.05, 2), 0.02], rng.uniform(0.0, np.pi))
        lean, heading = np.radians(rng.uniform(-20.0, 20.0)), rng.uniform(0.0, 2.0 * np.pi)
        n = [np.cos(lean) * np.cos(heading), np.cos(lean) * np.sin(heading), np.sin(lean)]
        assert planned((fragment,), (0,), Plane.through(fragment.p_WC, n)).carry is None


def test_a_level_plane_is_turned_upright_and_pressed(planned):
    fragment = box((0.05, 0.04, 0.03), [0.0, 0.02, 0.015], 0.3)
    plan = planned((fragment,), (0,), Plane.through(fragment.p_WC, Z))
    assert plan.carry.turned_deg == pytest.approx(90.0)
    assert "too flat" in plan.carry.why
    assert abs(plan.plane_W.normal[2]) < 1e-9


def test_a_long_slab_is_turned_onto_its_side_and_cut_along_its_length(planned):
    slab = box((0.185, 0.04, 0.012), [0.0, 0.0, 0.006], np.pi / 2.0)
    assert planned((slab,), (0,), Plane.through(slab.p_WC, Z)).carry is not None


def test_a_fragment_among_others_is_carried_away_from_them_and_not_turned(planned):
    row = tuple(box((0.03, 0.03, 0.03), [0.0, 0.031 * k, 0.015]) for k in range(-3, 4))
    plan = planned(row, (3,), Plane(X, 0.0))
    assert plan.carry.turned_deg == pytest.approx(0.0, abs=1e-6)
    assert "a neighbour is in the blade's way" in plan.carry.why


def test_the_halves_of_a_lump_are_cut_again_and_again(planned, lump):
    small = Mesh(0.6 * lump.vertices, lump.faces)
    rotation = Rotation.from_euler("X", np.pi / 2.0).as_matrix()
    lying = Fragment(small, Pose(rotation, [0.0, 0.0, -(small.vertices @ rotation.T)[:, 2].min()]))
    halves = slice_mesh(small, Plane.through(lying.p_WC, X).transformed(lying.X_WF.inverse()))
    now = tuple(
        Fragment(mesh, Pose(rotation, lying.X_WF.position + side * X))
        for mesh, side in zip(halves.products, (0.5e-3, -0.5e-3), strict=True)
    )
    plans = [planned(now, (0,), Plane.through(now[0].p_WC, normal)) for normal in (Y, X, Z)]
    assert [plan.meant for plan in plans] == [(0,)] * 3
    assert plans[2].carry is not None  # the plane lies flat


def test_several_fragments_are_cut_at_once_where_they_lie_and_only_there(planned):
    row = tuple(box((0.03, 0.03, 0.03), [0.0, 0.031 * k, 0.015]) for k in range(4))
    assert planned(row, (0, 1, 2, 3), Plane(X, 0.0)).carry is None
    result = plan_cut(row, (0, 1), Plane.through(row[0].p_WC, Z), RIG, HOME)
    assert isinstance(result, Refused)
    assert "several fragments at once are cut only where they lie" in result.reason


def test_what_lies_on_a_fragment_is_set_aside_first(planned):
    stack = box((0.06, 0.06, 0.02), [0, 0, 0.01]), box((0.06, 0.06, 0.02), [0, 0, 0.03])
    plan = planned(stack, (0,), Plane(Z, -0.01))
    assert plan.set_aside == (1,)
    assert plan.carry.fragment == 0, "the plane lies flat, so the fragment itself is turned as well"
    upright = planned(stack, (0,), Plane(X, 0.0))
    assert upright.set_aside == (1,)
    assert upright.carry is None, "with nothing on it, it is cut where it lies"
    assert planned(stack, (1,), Plane.through(stack[1].p_WC, Z)).set_aside == ()


def test_a_tower_is_set_aside_from_the_top(planned):
    tower = tuple(box((0.05, 0.05, 0.015), [0.002 * k, 0, 0.0075 + 0.015 * k]) for k in (2, 0, 1))
    assert planned(tower, (1,), Plane(X, 0.0)).set_aside == (0, 2)


def test_a_slice_that_leans_on_the_fragment_is_set_aside(planned):
    block = box((0.05, 0.05, 0.03), [0, 0, 0.015])
    tilted = Rotation.from_euler("y", 50.0, degrees=True).as_matrix()
    leaning = box((0.05, 0.04, 0.008), [0, 0, 0])
    low = leaning.mesh.vertices @ tilted.T
    leaning = Fragment(leaning.mesh, Pose(tilted, np.array([0.038, 0.0, -low[:, 2].min()])))
    plan = planned((block, leaning), (0,), Plane(Z, -0.015))
    assert plan.set_aside == (1,)


def test_what_is_too_much_for_the_gripper_is_not_set_aside_and_the_refusal_says_so():
    crowd = [box((0.06, 0.06, 0.02), [0, 0, 0.01]), box((0.48, 0.56, 0.02), [0, 0, 0.03])]
    result = plan_cut(tuple(crowd), (0,), Plane(X, 0.0), RIG, HOME)
    assert isinstance(result, Refused)
    assert "fragment 1, which lies on it" in result.reason


def test_a_fragment_that_never_fits_under_the_blade_is_refused():
    block = box((0.26, 0.26, 0.04), [0, 0, 0.02])
    result = plan_cut((block,), (0,), Plane.through(block.p_WC, Z), RIG, HOME)
    assert isinstance(result, Refused)
    assert "would not fit under the blade" in result.reason


def test_food_tougher_than_the_motors_is_refused():
    fragment = box((0.1, 0.05, 0.04), [0, 0, 0.02])
    result = plan_cut((fragment,), (0,), Plane.through(fragment.p_WC, X), RIG, HOME, 1000.0)
    assert isinstance(result, Refused)
    assert result.reason == "the motors are too weak for the press"


def test_a_fragment_out_of_reach_of_the_blade_is_carried_nearer_or_refused(planned):
    near = box((0.05, 0.04, 0.03), [0.0, 0.4, 0.015])
    planned((near,), (0,), Plane.through(near.p_WC, Z))
    far = box((0.05, 0.04, 0.03), [1.2, 0.0, 0.015])
    result = plan_cut((far,), (0,), Plane.through(far.p_WC, X), RIG, HOME)
    assert isinstance(result, Refused)
    assert result.reason.startswith("it is out of the arm's reach")


def test_a_plan_may_begin_in_any_posture_and_after_whole_turns_of_joints(planned):
    fragment = box((0.1, 0.05, 0.04), [0, 0, 0.02])
    wound = HOME + np.where(np.isinf([joint.low for joint in RIG.arm.joints]), 4.0 * np.pi, 0.0)
    wound[0] += 0.5
    plan = planned((fragment,), (0,), Plane.through(fragment.p_WC, X), q_now=wound)
    assert plan.legs[0].trajectory.positions[0] == pytest.approx(wound)


def test_the_same_cut_is_planned_the_same_bit_for_bit():
    row = tuple(box((0.03, 0.03, 0.03), [0.0, 0.031 * k, 0.015]) for k in range(-3, 4))
    plans = []
    for _ in range(2):
        rig = rig_of(gen3(), knife(SETTINGS), SETTINGS)
        again = tuple(Fragment(Mesh(f.mesh.vertices, f.mesh.faces), f.X_WF) for f in row)
        plans.append(plan_cut(again, (3,), Plane.through(row[3].p_WC, Z), rig, HOME, FORCE))
    for one, other in zip(plans[0].legs, plans[1].legs, strict=True):
        assert np.array_equal(one.trajectory.positions, other.trajectory.positions)
        assert np.array_equal(one.trajectory.accelerations, other.trajectory.accelerations)


def test_another_arm_makes_cuts(planned):
    text = (Path(__file__).parents[3] / "data" / "ur5e.urdf").read_text()
    rig = rig_of(read_urdf(text, "flange"), knife(SETTINGS), SETTINGS)
    fragment = box((0.05, 0.04, 0.03), [0.0, 0.02, 0.015], 0.3)
    assert planned((fragment,), (0,), Plane.through(fragment.p_WC, X), rig).carry is None
    assert planned((fragment,), (0,), Plane.through(fragment.p_WC, Z), rig).carry is not None
