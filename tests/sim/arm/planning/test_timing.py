import dataclasses

import numpy as np
import pytest

from cutgrammar.geometry.pose import Pose
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.planning.paths import find_line, find_posture, straight
from cutgrammar_sim.arm.planning.timing import STEP, ExternalLoad, find_trajectory, joined, limits_of, resting
from cutgrammar_sim.arm.robot.description import X_WA
from cutgrammar_sim.arm.robot.dynamics import Load, inverse_dynamics
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.kinematics import flange_poses
from cutgrammar_sim.arm.robot.tool import knife

ARM, TOOL = gen3(), knife(Settings())
LIMITS = limits_of(ARM, Settings().kinova)
UNLADEN = ExternalLoad((TOOL.load,))


def keeps_its_limits(t, limits=LIMITS):
    assert np.abs(t.velocities / limits.velocity).max() <= 1.0 + 1e-9
    assert np.abs(t.accelerations).max() <= limits.acceleration * (1.0 + 1e-9)
    assert t.velocities[[0, -1]] == pytest.approx(0.0)
    assert t.times == pytest.approx(STEP * np.arange(len(t.times)))
    # what it tells of velocities is how the positions change
    assert np.abs(np.diff(t.positions, axis=0) / STEP - (t.velocities[1:] + t.velocities[:-1]) / 2.0).max() < 0.02


def test_a_movement_is_as_fast_as_its_limits_allow(rng):
    for _ in range(5):
        goal = ARM.home + rng.uniform(-0.8, 0.8, 7)
        t = find_trajectory(ARM, straight(ARM.home, goal), LIMITS, UNLADEN)
        keeps_its_limits(t)
        assert t.positions[0] == pytest.approx(ARM.home)
        assert t.positions[-1] == pytest.approx(goal)
        # the time of the slowest joint alone, speeding up and slowing down evenly
        way, v, a = np.abs(goal - ARM.home), LIMITS.velocity, LIMITS.acceleration
        alone = np.where(way > v * v / a, way / v + v / a, 2.0 * np.sqrt(way / a)).max()
        assert alone <= t.times[-1] < 1.05 * alone + 2.0 * STEP


def line():
    X_WB = Pose(np.eye(3), [0.03, 0.02, 0.0])
    q = find_posture(ARM, X_WB, TOOL.X_TB)
    return find_line(ARM, X_WB, TOOL.X_TB, q, np.array([0.0, 0.0, 0.06])).reversed()


def test_the_edge_is_pressed_at_constant_speed():
    t = find_trajectory(ARM, line(), LIMITS, UNLADEN, speed=0.1)
    keeps_its_limits(t)
    X_AT = flange_poses(ARM, t.positions)
    height = X_WA.apply(X_AT[:, :3, :3] @ TOOL.X_TB.position + X_AT[:, :3, 3])[:, 2]
    speed = -np.diff(height) / STEP
    assert speed.max() <= 0.1 + 1e-6
    assert (speed > 0.098).mean() > 0.8  # but for the beginning and the end
    assert height[-1] == pytest.approx(0.0, abs=2e-6)


def test_torques_slow_a_movement_down_or_make_it_impossible():
    path = straight(ARM.home, ARM.home + np.array([0.4, 0.3, 0.0, 0.3, 0.0, 0.3, 0.5]))
    heavy = ExternalLoad((*UNLADEN.loads, Load(1.0, np.array([0.0, 0.0, 0.2]), 1e-3 * np.eye(3))))
    strong = find_trajectory(ARM, path, LIMITS, heavy)
    held = inverse_dynamics(ARM, strong.positions, 0.0 * strong.velocities, 0.0 * strong.velocities, heavy.loads)
    peak = np.abs(inverse_dynamics(ARM, strong.positions, strong.velocities, strong.accelerations, heavy.loads))
    max_held = np.abs(held).max(axis=0)
    weak = dataclasses.replace(
        LIMITS, torque=1.1 * max_held + 0.1 + 0.4 * np.maximum(peak.max(axis=0) - 1.1 * max_held, 0.0)
    )
    slowed = find_trajectory(ARM, path, weak, heavy)
    keeps_its_limits(slowed, weak)
    torques = inverse_dynamics(ARM, slowed.positions, slowed.velocities, slowed.accelerations, heavy.loads)
    assert (np.abs(torques) <= weak.torque).all()
    assert slowed.times[-1] > strong.times[-1]
    too_weak = dataclasses.replace(LIMITS, torque=0.9 * max_held)
    assert find_trajectory(ARM, path, too_weak, heavy) is None


def test_the_force_of_the_food_limits_the_press():
    assert find_trajectory(ARM, line(), LIMITS, UNLADEN, speed=0.1) is not None
    for force, possible in ((30.0, True), (500.0, False)):
        pushed = ExternalLoad(UNLADEN.loads, np.array([0.0, 0.0, force]), TOOL.X_TB.position)
        assert (find_trajectory(ARM, line(), LIMITS, pushed, speed=0.1) is not None) is possible


def test_movements_are_joined_without_a_gap():
    a = find_trajectory(ARM, straight(ARM.home, ARM.home + 0.2), LIMITS, UNLADEN)
    b = find_trajectory(ARM, straight(ARM.home + 0.2, ARM.home), LIMITS, UNLADEN)
    both = joined([a, b])
    assert both.times[-1] == pytest.approx(a.times[-1] + b.times[-1])
    keeps_its_limits(both)
    assert both.positions[-1] == pytest.approx(ARM.home)
    assert resting(ARM.home).times[-1] == 0.0
