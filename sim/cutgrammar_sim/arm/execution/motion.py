"""The `Motion` of a cut, for pictures and records, from the log and the plan."""

from collections.abc import Sequence

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.motion import Motion, Phase
from cutgrammar_sim.arm.execution.log import Log
from cutgrammar_sim.arm.planning.cut_plan import CutPlan
from cutgrammar_sim.arm.robot.appearance import links_of, poses_of, to_vectors
from cutgrammar_sim.arm.robot.description import Arm
from cutgrammar_sim.arm.robot.tool import Tool


def motion_of(
    arm: Arm, tool: Tool, plan: CutPlan, log: Log, loads: tuple[Floats, Floats], phases: Sequence[Phase]
) -> Motion:
    """The motion of a cut.

    Args:
        arm: the arm.
        tool: its tool.
        plan: that was carried out.
        log: of its legs and of the settling after them.
        loads: torques (t, n) of the motors and wrenches (t, 6) on the flange at the log's samples [N m; N, N m].
        phases: of the motion.
    """
    out = np.array([*(leg.gripper_out for leg in plan.legs), False])[log.legs]
    links = links_of(arm, tool)
    poses = poses_of(arm, tool, log.q, out)
    blade = next(i for i, link in enumerate(links) if link.name == "blade")
    return Motion(
        times=log.times,
        joints=tuple(joint.name for joint in arm.joints),
        positions=log.q,
        velocities=log.qd,
        torques=loads[0],
        position_limits=arm.position_limits,
        velocity_limits=arm.velocity_limits,
        torque_limits=arm.torque_limits,
        wrench_W=loads[1],
        blade_force=np.linalg.norm(log.pushes.forces_W, axis=1),
        links=links,
        poses=poses,
        X_WB=poses[:, blade],
        phases=tuple(phases),
    )


def phases_of(
    plan: CutPlan, log: Log, before: Configuration, placed: Configuration, after: Configuration, carried: Floats
) -> list[Phase]:
    """The phases of a plan's legs.

    Args:
        plan: that was carried out.
        log: of its legs.
        before, placed, after: the fragments before the plan, after one has been set down, and after the cut.
        carried: (k, 4, 4) X_WF of the carried fragment at the samples of the legs that hold it.
    """
    phases: list[Phase] = []
    lying, done = before, 0
    for number, leg in enumerate(plan.legs):
        first, count = int(np.searchsorted(log.legs, number)), int((log.legs == number).sum())
        if leg.holds and plan.carry is not None:
            poses = np.repeat([[fragment.X_WF.to_vector() for fragment in before]], count, axis=0)
            poses[:, plan.carry.fragment] = to_vectors(carried[done : done + count])
            phases.append(Phase(leg.phase, first, lying, poses))
            done, lying = done + count, placed
            continue
        phases.append(Phase(leg.phase, first, lying))
        if leg.phase == "press":
            lying = after
    return phases
