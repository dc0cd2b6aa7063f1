"""The `Motion` of a cut, for pictures and records, from the log and the plan."""

from collections.abc import Sequence

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.motion import Motion, Phase
from cutgrammar_sim.arm.execution.execute import Realised, placed_after
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


def phases_of(plan: CutPlan, realised: Realised, before: Configuration, after: Configuration) -> list[Phase]:
    """The phases of a plan's legs.

    Args:
        plan: that was carried out.
        realised: what happened.
        before, after: the fragments before the plan and after the cut.
    """
    phases: list[Phase] = []
    lying, legs = before, realised.log.legs
    done = [0] * len(plan.carries)
    for number, leg in enumerate(plan.legs):
        first, count = int(np.searchsorted(legs, number)), int((legs == number).sum())
        if leg.carry is None:
            phases.append(Phase(leg.phase, first, lying))
        else:
            which = plan.carries.index(leg.carry)
            poses = np.repeat([[fragment.X_WF.to_vector() for fragment in lying]], count, axis=0)
            poses[:, leg.carry.fragment] = to_vectors(realised.carried[which][done[which] : done[which] + count])
            phases.append(Phase(leg.phase, first, lying, poses))
            done[which] += count
            lying = placed_after(plan, before, realised.X_WF[: which + 1])
        if leg.phase == "press":
            lying = after
    return phases
