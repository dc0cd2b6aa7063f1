"""The arm with its tool in a SAPIEN scene: motors that follow a motion, and forces on the blade.

Gravity is off for arm and tool, as if the motors compensated it; the torques that this takes are
`dynamics.gravity_torques`. The motors get the torques of the planned motion (`feed_forward`), and a stiff drive
corrects the remaining error. In the scene the arm does not collide with itself, and its base and the link that turns on
it collide with nothing, because plans already avoid this.

The scene must not use PhysX's TGS solver (`Bodies(settings, tgs=False)`): with it, joints run 0.45 of a step ahead of
their targets, 0.002 rad at 1 rad/s, and read 4 % too slow. Without it they are within 1e-5 rad. PhysX moves a joint by
its velocity at the end of a step, so the target velocity is the mean over the step.
"""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.planning.loads import Pushes, pushed_torques
from cutgrammar_sim.arm.robot.appearance import blade_of
from cutgrammar_sim.arm.robot.description import X_WA, Arm, Capsule
from cutgrammar_sim.arm.robot.dynamics import Load, gravity_torques, inverse_dynamics
from cutgrammar_sim.arm.robot.tool import Tool
from cutgrammar_sim.physics.engine import convex_shape, physx, sapien, sapien_pose

STIFFNESS, DAMPING = 2000.0 / 39.0, 100.0 / 39.0
"""Gains of a motor's drive, per N m of its maximum torque [1/rad, s/rad]."""
TOUCHES = [1, 1, 1 << 5, 1]
"""Collision groups of parts that touch board and fragments, but no other part of the arm."""
ON_BOARD = [2, 2, 1 << 5, 1]
"""Collision groups of the blade: it touches the board, but passes through fragments."""
PASSES = [0, 0, 0, 0]
"""Collision groups of parts that touch nothing."""


class Articulation:
    """An arm with its tool in a scene; postures are (n,) [rad], forces and points are in W."""

    def __init__(self, arm: Arm, tool: Tool, body: Any, timestep: float) -> None:
        self.arm = arm
        self.tool = tool
        self._body = body
        self._timestep = timestep
        self._joints = body.get_active_joints()
        self._hand = body.get_links()[-1]
        self._gripper_in, self._gripper_out, self._blade = self._hand.get_collision_shapes()[-3:]
        for joint, max_torque in zip(self._joints, arm.torque_limits.tolist(), strict=True):
            joint.set_drive_properties(STIFFNESS * max_torque, DAMPING * max_torque, max_torque)
            joint.set_friction(0.0)
        self.set_contacts(blade=True, gripper_out=False)
        self.put(np.array(arm.home))

    def put(self, q: Floats) -> None:
        """Place the arm in the posture q, at rest."""
        self._body.set_qpos(q.astype(np.float32))
        self._body.set_qvel(np.zeros(q.size, dtype=np.float32))
        self._hold(q)

    def follow(
        self, q: Floats, feed: Floats, step: Callable[[], None], pushes: Pushes | None = None
    ) -> tuple[Floats, Floats]:
        """Carry out a motion, all of it prepared before its first step, then hold its last posture.

        Args:
            q: (t, n) target of the joints at the end of every step [rad].
            feed: (t, n) torques of the motion (see `feed_forward`) [N m].
            step: makes a step of the physics.
            pushes: forces on the blade in every step, which the motors compensate.

        Returns:
            (t, n) positions [rad] and velocities [rad/s] after every step.
        """
        path = np.concatenate([self._target[None], q])
        rates = np.diff(path, axis=0) / self._timestep
        if pushes is not None:
            feed = feed + pushed_torques(self.arm, path[:-1], pushes)
            forces, points = pushes.forces_W.astype(np.float32), pushes.p_WP.astype(np.float32)
        # one target for both: stiffness times d/k times the velocity is damping times the velocity
        targets = (q + DAMPING / STIFFNESS * rates).tolist()
        torques = feed.astype(np.float32)
        done = np.empty((2, *q.shape), dtype=np.float32)
        setters = [joint.set_drive_target for joint in self._joints]
        body, push = self._body, self._hand.add_force_at_point
        for k, target in enumerate(targets):
            for setter, angle in zip(setters, target, strict=True):
                setter(angle)
            body.set_qf(torques[k])
            if pushes is not None:
                push(forces[k], points[k])
            step()
            done[0, k] = body.get_qpos()
            done[1, k] = body.get_qvel()
        self._hold(path[-1])
        return done[0].astype(np.float64), done[1].astype(np.float64)

    def _hold(self, q: Floats) -> None:
        """Make the motors hold the posture q."""
        self._target = q
        for joint, angle in zip(self._joints, q.tolist(), strict=True):
            joint.set_drive_target(angle)
        self._body.set_qf(np.zeros(q.size, dtype=np.float32))

    def set_contacts(self, blade: bool, gripper_out: bool) -> None:
        """Set whether the blade touches the board, and whether the gripper counts as extended or retracted."""
        self._blade.set_collision_groups(ON_BOARD if blade else PASSES)
        for shape, on in ((self._gripper_out, gripper_out), (self._gripper_in, not gripper_out)):
            shape.set_collision_groups(TOUCHES if on else PASSES)

    @property
    def positions(self) -> Floats:
        """(n,) of the joints [rad]."""
        return np.asarray(self._body.get_qpos(), dtype=np.float64)

    @property
    def velocities(self) -> Floats:
        """(n,) of the joints [rad/s]."""
        return np.asarray(self._body.get_qvel(), dtype=np.float64)

    @property
    def entities(self) -> list[Any]:
        """SAPIEN's entities of the links, base first, and of the tool, whose frame is T."""
        return [link.entity for link in self._body.get_links()]


def feed_forward(arm: Arm, q: Floats, loads: Iterable[Load], timestep: float) -> Floats:
    """The torques that a motion needs beyond those against gravity, for the way in which PhysX integrates.

    Args:
        q: (t, n) posture at the end of every step; before, the arm rests in q[0] [rad].
        loads: bodies fixed to the flange, the tool among them.
        timestep: [s].

    Returns:
        (t, n) torque in each step [N m].
    """
    q = np.concatenate([q[:1], q[:1], q])
    velocity = np.diff(q, axis=0) / timestep
    loads = tuple(loads)
    moving = inverse_dynamics(arm, q[1:-1], velocity[:-1], np.diff(velocity, axis=0) / timestep, loads)
    return moving - gravity_torques(arm, q[1:-1], loads)


def build(scene: Any, arm: Arm, tool: Tool) -> Articulation:
    """Build the arm, at home and at rest, in `scene`, whose timestep is already set.

    Raises:
        ValueError: the scene uses the TGS solver.
    """
    if scene.physx_system.config.enable_tgs:
        raise ValueError("the arm's scene uses the TGS solver, with which joints run ahead; make it with tgs=False")
    return Articulation(arm, tool, _assemble(scene, arm, tool), scene.get_timestep())


def _assemble(scene: Any, arm: Arm, tool: Tool) -> Any:
    builder = scene.create_articulation_builder()
    builder.set_initial_pose(sapien_pose(X_WA))
    parent = None
    for i, link in enumerate(arm.links):
        parent = builder.create_link_builder(parent)
        parent.set_name(link.name)
        if i:
            joint = arm.joints[i - 1]
            turn = Pose(_x_along(joint.axis), np.zeros(3))
            parent.set_joint_name(joint.name)
            parent.set_joint_properties(
                "revolute_unwrapped", [[joint.low, joint.high]], sapien_pose(joint.X_PJ @ turn), sapien_pose(turn)
            )
        if i > 1:  # the first moving link turns on the base, behind the board and lower than its top
            for capsule in link.capsules:
                _cover(parent, capsule)
        _set_inertia(parent, link.mass, link.p_LC, link.inertia)
    hand = builder.create_link_builder(parent)
    hand.set_name("tool")
    hand.set_joint_properties("fixed", [], sapien_pose(arm.X_LT), sapien.Pose())
    _set_inertia(hand, tool.load.mass, tool.load.p_TC, tool.load.inertia)
    _cover(hand, tool.handle)
    _cover(hand, tool.gripper_in)
    _cover(hand, tool.gripper_out)
    body = builder.build(fix_root_link=True)
    body.get_links()[-1].attach(_blade(tool))
    for link in body.get_links():
        link.set_disable_gravity(True)
        link.set_linear_damping(0.0)
        link.set_angular_damping(0.0)
        for shape in link.get_collision_shapes():
            shape.set_collision_groups(TOUCHES)
            shape.contact_offset = 0.002
    return body


def _blade(tool: Tool) -> Any:
    """The blade's shape with its ground edge, so that it touches the board with the edge alone, however it leans."""
    shape = convex_shape(blade_of(tool).vertices, physx.get_default_material())
    shape.set_local_pose(sapien_pose(tool.X_TB))
    return shape


def _set_inertia(link: Any, mass: float, p_LC: Floats, inertia: Floats) -> None:
    """Set a link's inertia by its principal axes."""
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    link.set_mass_and_inertia(mass, sapien_pose(Pose(axes, p_LC)), moments.astype(np.float32))


def _cover(link: Any, capsule: Capsule) -> None:
    """Add a capsule to a link's collision shape; SAPIEN's capsules lie along x."""
    a, b = capsule.ends
    length = float(np.linalg.norm(b - a))
    turn = _x_along((b - a) / length) if length > 1e-9 else np.eye(3)
    link.add_capsule_collision(sapien_pose(Pose(turn, (a + b) / 2.0)), capsule.radius, max(length, 1e-4) / 2.0)


def _x_along(axis: Floats) -> Floats:
    """(3, 3) rotation that maps x to the unit vector `axis`."""
    other = np.eye(3)[np.argmin(np.abs(axis))]
    y = np.cross(other, axis)
    y /= np.linalg.norm(y)
    return np.column_stack([axis, y, np.cross(axis, y)])
