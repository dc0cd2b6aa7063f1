import hashlib

import numpy as np
import pytest
import sapien
from sapien import physx

from cutgrammar.settings import Settings
from cutgrammar_sim.arm.execution.articulation import DAMPING, STIFFNESS, build, feed_forward
from cutgrammar_sim.arm.planning.loads import Pushes, flange_wrenches
from cutgrammar_sim.arm.robot.description import X_WA
from cutgrammar_sim.arm.robot.dynamics import gravity_torques, inverse_dynamics
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.kinematics import flange_pose, flange_poses, link_poses
from cutgrammar_sim.arm.robot.tool import knife

STEP = 1.0 / 240.0


def new_scene(tgs=False):
    physx.set_scene_config(enable_tgs=tgs)
    scene = sapien.Scene([physx.PhysxCpuSystem()])
    scene.set_timestep(STEP)
    return scene


@pytest.fixture
def mounted():
    """An arm at home in a fresh scene, and the function that steps the scene."""
    scene = new_scene()
    return build(scene, gen3(), knife(Settings())), scene.step


def swing(seconds):
    """(t, 7) postures at the end of every step of a motion of all joints from home and back, at up to 1 rad/s."""
    times = np.arange(1, round(seconds / STEP) + 1)[:, None] * STEP
    size = np.array([0.6, 0.4, 0.6, 0.4, 0.6, 0.4, 0.6])
    return gen3().home + size * (1.0 - np.cos(times / size))


def follow(articulation, step, q):
    """Positions, and motor torques without those against gravity, after every step."""
    feed = feed_forward(articulation.arm, q, [articulation.tool.load], STEP)
    positions, velocities = articulation.follow(q, feed, step)
    max_torques = np.array([joint.torque for joint in articulation.arm.joints])
    rates = np.diff(np.concatenate([articulation.arm.home[None], q]), axis=0) / STEP
    return positions, feed + max_torques * (STIFFNESS * (q - positions) + DAMPING * (rates - velocities))


def stand(articulation, step, count, force_W=(0.0, 0.0, 0.0), p_WP=(0.0, 0.0, 0.0)):
    """Stay at home under a force that grows for a fifth of a second."""
    grown = np.minimum(1.0, np.arange(count) / 48)[:, None] * force_W
    still = np.zeros((count, 7))
    articulation.follow(still + articulation.arm.home, still, step, Pushes(grown, np.tile(p_WP, (count, 1))))


def blade_error(tool, q, meant):
    """Largest angle [rad] and distance [m] between the planes of the blade in pairs of postures."""
    X_TB = np.eye(4)
    X_TB[:3, :3], X_TB[:3, 3] = tool.X_TB.rotation, tool.X_TB.position
    X, Y = (flange_poses(gen3(), postures) @ X_TB for postures in (q, meant))
    angles = np.linalg.norm(np.cross(X[:, :3, 0], Y[:, :3, 0]), axis=1)
    away = np.einsum("ta,ta->t", X[:, :3, 3] - Y[:, :3, 3], Y[:, :3, 0])
    return angles.max(), np.abs(away).max()


def test_the_blade_follows_a_fast_motion_of_all_joints(mounted):
    q = swing(2.0)
    positions, _ = follow(*mounted, q)
    angle, away = blade_error(mounted[0].tool, positions, q)
    assert np.abs(positions - q).max() < 1e-4
    assert np.degrees(angle) < 0.02
    assert away < 4e-5


def test_the_blade_holds_its_position_under_a_force_that_the_motors_compensate(mounted):
    articulation, step = mounted
    home = articulation.arm.home
    p_WB = X_WA.apply((flange_pose(articulation.arm, home) @ articulation.tool.X_TB).position)
    stand(articulation, step, 120, (5.0, 0.0, 60.0), p_WB)
    angle, away = blade_error(articulation.tool, articulation.positions[None], home[None])
    assert np.degrees(angle) < 0.02
    assert away < 4e-5


def test_the_wrench_on_the_flange_is_the_force_on_the_blade_and_the_weight_of_the_tool(mounted):
    articulation, step = mounted
    arm, tool = articulation.arm, articulation.tool
    X_WT = X_WA @ flange_pose(arm, arm.home)
    p_WB = X_WT.apply(tool.X_TB.position)
    push = np.array([3.0, -4.0, 50.0])
    stand(articulation, step, 100, push, p_WB)
    weight = np.array([0.0, 0.0, -9.81 * tool.load.mass])
    turning = np.cross(p_WB - X_WT.position, push) + np.cross(X_WT.rotate(tool.load.p_TC), weight)
    pushes = Pushes(np.tile(push, (3, 1)), np.tile(p_WB, (3, 1)))
    expected = flange_wrenches(arm, STEP * np.arange(3), np.tile(arm.home, (3, 1)), [tool.load], pushes)[1]
    assert expected == pytest.approx(np.concatenate([push + weight, turning]), abs=1e-9)
    joints = articulation.entities[-1].components[0].articulation.get_link_incoming_joint_forces()
    felt = np.concatenate(np.split(-np.asarray(joints[-1], dtype=np.float64), 2) @ X_WT.rotation.T)
    felt += np.concatenate([weight, np.cross(X_WT.rotate(tool.load.p_TC), weight)])
    assert felt == pytest.approx(expected, abs=0.01)


def test_motors_give_the_torques_of_the_motion(mounted):
    q = swing(1.0)
    positions, torques = follow(*mounted, q)
    load = mounted[0].tool.load
    borne = torques + gravity_torques(gen3(), positions, [load])
    velocities = np.gradient(positions, STEP, axis=0)
    taken = inverse_dynamics(gen3(), positions, velocities, np.gradient(velocities, STEP, axis=0), [load])
    assert np.abs(borne - taken)[10:-10].max() < 0.2


def test_links_in_the_scene_are_where_the_kinematics_put_them(mounted, rng):
    articulation, _ = mounted
    low, high = np.array([[max(j.low, -3.1), min(j.high, 3.1)] for j in articulation.arm.joints]).T
    for q in rng.uniform(low, high, (20, 7)):
        articulation.put(q)
        poses = link_poses(articulation.arm, q)[0]
        for entity, X_AL in zip(articulation.entities, poses, strict=False):
            assert entity.pose.p == pytest.approx(X_WA.apply(X_AL[:3, 3]), abs=1e-6)
        assert articulation.entities[-1].pose.p == pytest.approx(
            X_WA.apply(flange_pose(articulation.arm, q).position), abs=1e-6
        )


def test_the_same_motion_twice_is_the_same_bit_by_bit():
    digests = set()
    for _ in range(2):
        scene = new_scene()
        positions, _ = follow(build(scene, gen3(), knife(Settings())), scene.step, swing(0.5))
        digests.add(hashlib.sha256(positions.tobytes()).hexdigest())
    assert len(digests) == 1


def test_a_scene_with_the_tgs_solver_is_refused():
    with pytest.raises(ValueError, match="tgs=False"):
        build(new_scene(tgs=True), gen3(), knife(Settings()))


def test_the_blade_touches_the_board_only_when_contacts_are_on():
    for touching in (True, False):
        scene = new_scene()
        articulation = build(scene, gen3(), knife(Settings()))
        edge = (X_WA @ flange_pose(articulation.arm, articulation.arm.home) @ articulation.tool.X_TB).position
        builder = scene.create_actor_builder()
        builder.add_box_collision(half_size=[0.02, 0.02, 0.02])
        builder.initial_pose = sapien.Pose(edge)
        board = builder.build_kinematic()
        board.components[0].collision_shapes[0].set_collision_groups([3, 3, 0, 0])
        articulation.set_contacts(blade=touching, gripper_out=False)
        scene.step()
        felt = [contact for contact in scene.get_contacts() if any(point.separation < 0.0 for point in contact.points)]
        assert bool(felt) == touching


def test_the_arm_can_be_pushed_out_of_its_posture_where_motors_are_weak(mounted):
    articulation, step = mounted
    home = articulation.arm.home
    body = articulation.entities[-1].components[0]
    for _ in range(60):
        body.add_force_at_point(np.array([0.0, 0.0, 120.0], dtype=np.float32), articulation.entities[-1].pose.p)
        step()
    assert np.abs(articulation.positions - home).max() > 0.05


def test_joints_move_again_after_a_long_rest(mounted):
    articulation, step = mounted
    home = articulation.arm.home
    for _ in range(240):
        step()
    q = home + np.arange(1, 101)[:, None] * 2e-5
    articulation.follow(q, np.zeros_like(q), step)
    assert np.abs(articulation.positions - q[-1]).max() < 1e-4


def test_the_arm_holds_the_last_posture_of_a_motion(mounted):
    articulation, step = mounted
    q = swing(0.7)
    follow(articulation, step, q)
    for _ in range(60):
        step()
    assert np.abs(articulation.positions - q[-1]).max() < 2e-4
