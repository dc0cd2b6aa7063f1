"""Carrying out a plan: the arm follows its trajectories in the scene, and a log records what happens.

"Depth and lock": all fragments are held while the arm moves. Those that it handles are taken out of the physics, for
only the arm moves them: their poses follow from the actual poses of the gripper when it closed and opened. Whatever can
be computed from the log is computed after the motion, not at every step.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.execution.articulation import DAMPING, STIFFNESS, Articulation, feed_forward
from cutgrammar_sim.arm.execution.log import Log, joined, still
from cutgrammar_sim.arm.planning.cut_plan import CutPlan
from cutgrammar_sim.arm.planning.forecast import in_world, loads_in, pushes_on
from cutgrammar_sim.arm.planning.legs import Leg
from cutgrammar_sim.arm.planning.loads import Pushes, flange_wrenches, pushed_torques
from cutgrammar_sim.arm.planning.timing import STEP
from cutgrammar_sim.arm.robot.description import Arm
from cutgrammar_sim.arm.robot.dynamics import gravity_torques, inverse_dynamics
from cutgrammar_sim.arm.robot.pinocchio_model import to_se3
from cutgrammar_sim.arm.robot.tool import Tool
from cutgrammar_sim.physics.toughness import Resistance


@dataclass(frozen=True, eq=False)
class Realised:
    """The actual poses of blade and gripper, as opposed to the planned ones.

    Attributes:
        log: of all legs.
        X_WF: of the fragment of each carry, once it is set down.
        carried: (k, 4, 4) for each carry, X_WF of its fragment at every sample of the legs that hold it.
        X_WB: (m, 4, 4) of the blade at every sample from the first touch of the food to the end of the press.
        lowest: height of the edge's lowest point at the end of the press [m].
    """

    log: Log
    X_WF: tuple[Pose, ...]
    carried: tuple[Floats, ...]
    X_WB: Floats
    lowest: float

    def placed(self, plan: CutPlan, before: Configuration) -> Configuration:
        """The fragments after all carries."""
        return placed_after(plan, before, self.X_WF)

    def plane_W(self, meant_W: Plane) -> Plane:
        """The mean plane of the blade, with its normal on the side of that of the plane meant."""
        normals = self.X_WB[:, :3, 0] * np.sign(self.X_WB[:, :3, 0] @ meant_W.normal)[:, None]
        return Plane.through(self.X_WB[:, :3, 3].mean(axis=0), normals.mean(axis=0))

    def plane_error(self, meant_W: Plane, p_WS: Floats) -> tuple[float, float]:
        """The largest error of the blade during the press.

        Args:
            meant_W: the plane meant.
            p_WS: (m, 3) points of its section through the fragment.

        Returns:
            Largest angle between the planes [rad], and largest distance of any of the points from the blade [m].
        """
        normals = self.X_WB[:, :3, 0]
        sine = np.linalg.norm(np.cross(normals, meant_W.normal), axis=1)
        angles = np.arctan2(sine, np.abs(normals @ meant_W.normal))
        offsets = np.einsum("ka,ka->k", normals, self.X_WB[:, :3, 3])
        return float(angles.max()), float(np.abs(normals @ p_WS.T - offsets[:, None]).max())


def placed_after(plan: CutPlan, before: Configuration, X_WF: Sequence[Pose]) -> Configuration:
    """The fragments after the first carries of a plan, which set fragments down at X_WF."""
    moved = {
        carry.fragment: Fragment(before[carry.fragment].shape, X) for carry, X in zip(plan.carries, X_WF, strict=False)
    }
    return tuple(moved.get(index, fragment) for index, fragment in enumerate(before))


def carry_out(
    plan: CutPlan, now: Configuration, met: Resistance, body: Articulation, step: Callable[[], None]
) -> Realised:
    """Let the arm follow a plan in its scene.

    Args:
        plan: the movements.
        now: the fragments as they lie.
        met: resistance that the blade meets.
        body: the arm, at rest where the plan begins.
        step: makes one step of the physics.
    """
    arm, tool = body.arm, body.tool
    logs = [still(np.zeros(1), body.positions[None], body.velocities[None], plan.legs[0].trajectory.positions[0], 0)]
    for number, leg in enumerate(plan.legs):
        path = leg.trajectory.positions
        pushes = pushes_on(plan, path, met, arm, tool) if leg.phase == "press" else None
        logs.append(_follow(body, leg, pushes, number, float(logs[-1].times[-1]), step))
    log = joined(logs)
    X_WF, carried = _carried(plan, now, log, arm, tool)
    press = next(number for number, leg in enumerate(plan.legs) if leg.phase == "press")
    blades = in_world(arm, log.q[log.legs == press], tool.X_TB)
    depths = blades[:, :3, 3] @ -plan.X_WB.rotation[:, 2]
    inside = blades[depths >= min(float(met.depths[0]), float(depths[-1]))]
    ends = blades[-1, :3, 3] + np.outer([-0.5, 0.5], tool.length * blades[-1, :3, 1])
    return Realised(log, X_WF, carried, inside, float(ends[:, 2].min()))


def motor_loads(
    plan: CutPlan, now: Configuration, log: Log, arm: Arm, tool: Tool, density: float
) -> tuple[Floats, Floats]:
    """Torques of the motors (t, n) [N m] and wrenches on the flange (t, 6) [N, N m] over a log.

    A motor's torque is the sum of its drive's correction, the feed-forward for motion and food, and what holds the arm,
    the tool and the carried fragment against gravity.
    """
    torques = log.feed + arm.torque_limits * (STIFFNESS * (log.aim - log.q) + DAMPING * (log.rate - log.qd))
    torques += pushed_torques(arm, log.q, log.pushes) + gravity_torques(arm, log.q, (tool.load,))
    wrenches = flange_wrenches(arm, log.times, log.q, (tool.load,), log.pushes)
    for number, leg in enumerate(plan.legs):
        at, loads = log.legs == number, loads_in(leg, now, tool, density)[1:]
        if loads and at.any():
            rates = np.gradient(log.rate[at], log.times[at], axis=0)
            moves = log.q[at], log.qd[at], rates
            torques[at] += inverse_dynamics(arm, *moves, loads) - inverse_dynamics(arm, *moves)
            wrenches[at] += flange_wrenches(arm, log.times[at], log.q[at], loads, None)
    return torques, wrenches


def _follow(
    body: Articulation, leg: Leg, pushes: Pushes | None, number: int, began: float, step: Callable[[], None]
) -> Log:
    """Follow the trajectory of one leg; the arm is already at its first sample."""
    path = leg.trajectory.positions
    feed = feed_forward(body.arm, path, (body.tool.load,), STEP)
    body.set_contacts(blade=True, gripper_out=leg.gripper_out)
    pushes = None if pushes is None else Pushes(pushes.forces_W[1:], pushes.p_WP[1:])
    q, qd = body.follow(path[1:], feed[1:], step, pushes)
    none = np.zeros((len(path) - 1, 3))
    return Log(
        times=began + leg.trajectory.times[1:],
        q=q,
        qd=qd,
        aim=path[1:],
        rate=np.diff(path, axis=0) / STEP,
        feed=feed[1:],
        pushes=Pushes(none, none) if pushes is None else pushes,
        legs=np.full(len(path) - 1, number),
    )


def _carried(
    plan: CutPlan, now: Configuration, log: Log, arm: Arm, tool: Tool
) -> tuple[tuple[Pose, ...], tuple[Floats, ...]]:
    """Pose at which the fragment of each carry was set down, and its poses (k, 4, 4) while it was held."""
    ends, paths = [], []
    for carry in plan.carries:
        held = [number for number, leg in enumerate(plan.legs) if leg.carry is carry]
        picked = int(np.flatnonzero(log.legs == held[0] - 1)[-1])
        at = np.append(picked, np.flatnonzero(np.isin(log.legs, held)))
        grippers = in_world(arm, log.q[at], tool.X_TG)
        X_GF = np.linalg.inv(grippers[0]) @ to_se3(now[carry.fragment].X_WF).homogeneous
        carried = grippers[1:] @ X_GF
        u, _, vt = np.linalg.svd(carried[-1, :3, :3])  # removes the rounding errors of many products
        ends.append(Pose(u @ vt, carried[-1, :3, 3]))
        paths.append(carried)
    return tuple(ends), tuple(paths)
