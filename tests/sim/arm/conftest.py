"""An oracle for plans of cuts: it checks everything that a plan promises, from its samples, by plain geometry."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.planning.loads import load_of_fragment
from cutgrammar_sim.arm.planning.timing import STEP
from cutgrammar_sim.arm.robot.description import X_WA
from cutgrammar_sim.arm.robot.dynamics import inverse_dynamics
from cutgrammar_sim.arm.robot.kinematics import link_poses
from cutgrammar_sim.physics.section import section

NUMBERS = np.random.default_rng(7)
SPHERE = NUMBERS.normal(size=(30, 3))
SPHERE /= np.linalg.norm(SPHERE, axis=1)[:, None]
STRIDE = 12
"""Positions are compared with fragments at every sample of this stride."""
CARRY, PHASES = ["transit", "pick", "carry", "place", "retreat"], ["transit", "approach", "press", "retreat", "transit"]


@pytest.fixture(scope="session")
def check_plan():
    """The oracle."""
    return check


def check(plan, now, plane_W, rig, q_now, density=1000.0):
    """Assert that `plan` makes the cut, keeps all limits and touches only what it must."""
    n = len(CARRY)
    assert [leg.phase for leg in plan.legs] == CARRY * len(plan.carries) + PHASES
    joins_and_keeps_limits(plan, rig, q_now)
    bears_the_loads(plan, now, rig, density)
    lying = [now]
    for number, carry in enumerate(plan.carries):
        legs, fragment = plan.legs[n * number : n * (number + 1)], lying[-1][carry.fragment]
        assert [leg.carry for leg in legs] == [None, None, carry, carry, None]
        picked, placed = (tool_at(rig, leg.trajectory.positions[-1:])[0] @ rig.tool.X_TG for leg in (legs[1], legs[3]))
        assert_same_pose(picked @ carry.X_GF, fragment.X_WF)
        assert_same_pose(placed @ carry.X_GF, carry.X_WF)
        assert carry.X_WF.apply(fragment.mesh.vertices)[:, 2].min() == pytest.approx(0.0, abs=1e-9)
        after = Fragment(fragment.shape, carry.X_WF)
        lying.append(tuple(after if i == carry.fragment else f for i, f in enumerate(lying[-1])))
    assert all(leg.carry is None for leg in plan.legs[n * len(plan.carries) :])
    if plan.carry is not None:
        assert plan.meant == (plan.carry.fragment,)
        moved = plane_W.transformed(plan.carry.X_WF @ now[plan.carry.fragment].X_WF.inverse())
        assert plan.plane_W.to_vector() == pytest.approx(moved.to_vector())
    else:
        assert plan.plane_W is plane_W
    presses_the_plane(plan, lying[-1], rig)
    touches_nothing(plan, lying, rig)


def tool_at(rig, q):
    """X_WT in every posture."""
    X = link_poses(rig.arm, q)[:, -1]
    return [X_WA @ Pose(x[:3, :3], x[:3, 3]) @ rig.arm.X_LT for x in X]


def assert_same_pose(X_AB, X_AC):
    assert np.abs(X_AB.position - X_AC.position).max() < 2e-5
    assert np.abs(X_AB.rotation - X_AC.rotation).max() < 1e-4


def joins_and_keeps_limits(plan, rig, q_now):
    at = q_now
    for leg in plan.legs:
        t = leg.trajectory
        assert t.positions[0] == pytest.approx(at)
        assert t.velocities[[0, -1]] == pytest.approx(0.0)
        assert t.times == pytest.approx(STEP * np.arange(len(t.times)))
        assert (np.abs(t.velocities) <= rig.limits.velocity * (1.0 + 1e-9)).all()
        assert (np.abs(t.accelerations) <= rig.limits.acceleration * (1.0 + 1e-9)).all()
        for i, joint in enumerate(rig.arm.joints):
            assert joint.low <= t.positions[:, i].min()
            assert t.positions[:, i].max() <= joint.high
        if len(t.times) > 1:
            slopes = np.diff(t.positions, axis=0) / STEP
            assert np.abs(slopes - (t.velocities[1:] + t.velocities[:-1]) / 2.0).max() < 0.02
        at = t.positions[-1]
    assert np.cos(at - rig.arm.home) == pytest.approx(1.0)


def bears_the_loads(plan, now, rig, density):
    limits = np.array([joint.torque for joint in rig.arm.joints])
    for leg in plan.legs:
        loads = [rig.tool.load]
        if leg.carry is not None:
            mesh = now[leg.carry.fragment].mesh
            loads.append(load_of_fragment(mesh, rig.tool.X_TG @ leg.carry.X_GF, density))
        t = leg.trajectory
        assert (np.abs(inverse_dynamics(rig.arm, t.positions, t.velocities, t.accelerations, loads)) <= limits).all()


def presses_the_plane(plan, after_carry, rig):
    n, half = plan.plane_W.normal, rig.tool.length / 2.0
    press = next(leg for leg in plan.legs if leg.phase == "press").trajectory
    X_WB = [X_WT @ rig.tool.X_TB for X_WT in tool_at(rig, press.positions)]
    for X in X_WB:
        assert abs(X.rotation[:, 0] @ n) > np.cos(np.radians(0.01))
        corners = X.apply(np.array([[0.0, -half, 0.0], [0.0, half, 0.0], [0.0, 0.0, rig.tool.height]]))
        assert np.abs(plan.plane_W.distances(corners)).max() < 0.05e-3
        assert abs(corners[0, 2] - corners[1, 2]) < 0.05e-3
    assert_same_pose(X_WB[-1], plan.X_WB)
    assert X_WB[-1].position[2] == pytest.approx(0.0, abs=1e-5)
    cuts = [X_WB[-1].inverse().apply(section(after_carry[i], plan.plane_W).reshape(-1, 3)) for i in plan.meant]
    for cut in cuts:
        assert np.abs(cut[:, 1]).max() < half
        assert cut[:, 2].max() <= rig.tool.height
    # the edge is above the section when the press begins, and has its speed when it gets there
    start = (
        X_WB[0]
        .inverse()
        .apply(np.concatenate([section(after_carry[i], plan.plane_W).reshape(-1, 3) for i in plan.meant]))
    )
    assert start[:, 2].max() < 0.0
    speed = np.linalg.norm(np.diff([X.position for X in X_WB], axis=0), axis=1) / STEP
    height = np.array([X.position[2] for X in X_WB])[:-1] / X_WB[0].rotation[2, 2]
    within = (height < max(cut[:, 2].max() for cut in cuts)) & (height > 5e-3)
    assert speed.max() <= rig.press_speed * (1.0 + 1e-6)
    assert speed[within].min() > 0.95 * rig.press_speed


def touches_nothing(plan, lying, rig):
    """Assert that no point of a link, the tool or the fragment held is in a fragment or under the board.

    `lying` are the fragments before the first carry, and after each.
    """
    tool, after_carry = rig.tool, lying[-1]
    y, z = np.meshgrid(np.linspace(-0.5, 0.5, 41) * tool.length, np.linspace(0.0, tool.height, 12))
    blade_T = tool.X_TB.apply(np.column_stack([np.zeros(y.size), y.ravel(), z.ravel()]))
    # the fragment that is picked up and let go may be touched meanwhile: by the needles, which are no capsule
    for number, leg in enumerate(plan.legs):
        which, part = divmod(number, len(CARRY))
        carry = plan.carries[which] if which < len(plan.carries) else None
        standing = after_carry if carry is None else lying[which + (part >= 2)]
        others = [
            f for i, f in enumerate(standing) if not (carry is not None and i == carry.fragment and 1 <= part <= 4)
        ]
        planes = [ConvexHull(f.X_WF.apply(f.mesh.vertices)).equations for f in others]
        tallest = max((f.X_WF.apply(f.mesh.vertices)[:, 2].max() for f in others), default=0.0)
        q = leg.trajectory.positions[::STRIDE]
        X_AL = link_poses(rig.arm, q)
        for k, X_WT in enumerate(tool_at(rig, q)):
            gripper = tool.gripper_out if leg.gripper_out else tool.gripper_in
            points = [X_WT.apply(on(capsule)) for capsule in (tool.handle, gripper)]
            for i, link in enumerate(rig.arm.links[2:], start=2):
                X = X_AL[k, i]
                points += [X_WA.apply(on(c) @ X[:3, :3].T + X[:3, 3]) for c in link.capsules]
            blade = X_WT.apply(blade_T)
            if leg.phase not in ("approach", "press", "retreat"):
                points.append(blade)
            if leg.carry is not None:
                X_WF = X_WT @ tool.X_TG @ carry.X_GF
                held = X_WF.apply(standing[carry.fragment].mesh.vertices)
                assert held[:, 2].min() > -1e-4
                if part == 3 or k > len(q) // 2:  # it may scrape along neighbours as it is lifted
                    points.append(held)
            every = np.concatenate(points)
            assert every[:, 2].min() > -1e-4
            assert blade[:, 2].min() > -1e-4
            low = every[every[:, 2] < tallest]
            for sides in planes:
                assert not ((low @ sides[:, :3].T + sides[:, 3]) < -1e-4).all(axis=1).any(), (number, leg.phase, k)
    # the blade's way down cuts no other fragment by more than a brush
    swath = plan.X_WB.inverse()
    for i, fragment in enumerate(after_carry):
        if i in plan.meant:
            continue
        corners = swath.apply(fragment.X_WF.apply(fragment.mesh.vertices))
        if corners[:, 0].min() < -0.6e-3 and corners[:, 0].max() > 0.6e-3:
            cut = swath.apply(section(fragment, plan.plane_W).reshape(-1, 3))
            beyond = np.abs(cut[:, 1]) > tool.length / 2.0 - 0.6e-3
            assert beyond.all()


def on(capsule):
    """(k, 3) points on a capsule."""
    a, b = capsule.ends
    return (a + np.linspace(0.0, 1.0, 8)[:, None, None] * (b - a) + capsule.radius * SPHERE).reshape(-1, 3)
