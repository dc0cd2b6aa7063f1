"""The forces that a plan will meet and the torques that it will need, before anything moves."""

from collections.abc import Mapping

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.planning.cut_plan import CutPlan
from cutgrammar_sim.arm.planning.legs import Leg
from cutgrammar_sim.arm.planning.loads import Pushes, load_of_fragment, pushed_torques
from cutgrammar_sim.arm.robot.description import X_WA, Arm
from cutgrammar_sim.arm.robot.dynamics import Load, inverse_dynamics
from cutgrammar_sim.arm.robot.kinematics import flange_poses
from cutgrammar_sim.arm.robot.pinocchio_model import to_se3
from cutgrammar_sim.arm.robot.tool import Tool
from cutgrammar_sim.physics.section import section
from cutgrammar_sim.physics.toughness import Resistance, resistance

UNITS = {"torque": "N m", "velocity": "rad/s"}


def resistance_to(plan: CutPlan, now: Configuration, toughness: Mapping[int, float], tool: Tool) -> Resistance:
    """The resistance that the blade of a plan meets in the fragments that it cuts.

    Args:
        plan: the movements.
        now: the fragments as they lie before it.
        toughness: of each fragment that is cut, by index [J/m2].
        tool: the tool with the blade.
    """
    carry, rotation = plan.carry, plan.X_WB.rotation
    poses = {i: carry.X_WF if carry is not None and carry.fragment == i else now[i].X_WF for i in plan.meant}
    sections = [section(Fragment(now[i].shape, X_WF), plan.plane_W) for i, X_WF in poses.items()]
    return resistance(sections, [toughness[i] for i in plan.meant], rotation[:, 1], -rotation[:, 2], tool.height)


def pushes_on(plan: CutPlan, q: Floats, met: Resistance, arm: Arm, tool: Tool) -> Pushes:
    """The forces on a plan's blade in the postures q (t, n) of its press."""
    across, along = plan.X_WB.rotation[:, 1], -plan.X_WB.rotation[:, 2]
    edge = in_world(arm, q, tool.X_TB)[:, :3, 3]
    felt = np.array([met.at(depth) for depth in edge @ along])
    at_edge = edge + (felt[:, 1] - edge @ across)[:, None] * across
    return Pushes(-felt[:, :1] * along, np.where(felt[:, :1] > 0.0, at_edge, edge))


def loads_in(leg: Leg, now: Configuration, tool: Tool, density: float) -> tuple[Load, ...]:
    """The loads on the flange in a leg: the tool, then the fragment that the gripper holds."""
    if leg.carry is None:
        return (tool.load,)
    return tool.load, load_of_fragment(now[leg.carry.fragment].mesh, tool.X_TG @ leg.carry.X_GF, density)


def overload(plan: CutPlan, now: Configuration, met: Resistance, arm: Arm, tool: Tool, density: float) -> str | None:
    """Which joint would exceed its torque in a plan, and in which phase, in words; None if none would."""
    for leg in plan.legs:
        path, loads = leg.trajectory, loads_in(leg, now, tool, density)
        torques = inverse_dynamics(arm, path.positions, path.velocities, path.accelerations, loads)
        if leg.phase == "press":
            torques += pushed_torques(arm, path.positions, pushes_on(plan, path.positions, met, arm, tool))
        reason = exceeded(arm, torques, "torque", leg.phase)
        if reason is not None:
            return reason
    return None


def exceeded(arm: Arm, values: Floats, quantity: str, phase: str) -> str | None:
    """Which joint exceeds its limit the most, in words; None if none does.

    Args:
        values: (t, n) of the joints.
        quantity: "torque" or "velocity".
        phase: name of the phase.
    """
    limits = {"torque": arm.torque_limits, "velocity": arm.velocity_limits}[quantity]
    shares = np.abs(values).max(axis=0) / limits
    worst = int(np.argmax(shares))
    if shares[worst] <= 1.0:
        return None
    reached, unit = shares[worst] * limits[worst], UNITS[quantity]
    return (
        f"{arm.joints[worst].name} exceeds its {quantity} in the {phase}: "
        f"{reached:.1f} {unit} where {limits[worst]:.1f} is the most"
    )


def in_world(arm: Arm, q: Floats, X_TS: Pose) -> Floats:
    """(t, 4, 4) X_WS of a frame S that is fixed to the flange, in the postures q (t, n)."""
    return np.asarray(to_se3(X_WA).homogeneous @ flange_poses(arm, q) @ to_se3(X_TS).homogeneous)
