"""The movements of a plan: paths, in their order, and the same with their times."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Refused
from cutgrammar_sim.arm.planning.carrying import Hold, find_placing
from cutgrammar_sim.arm.planning.loads import load_of_fragment
from cutgrammar_sim.arm.planning.paths import Path, nearest_turns
from cutgrammar_sim.arm.planning.rig import Rig
from cutgrammar_sim.arm.planning.scene import PlanningScene
from cutgrammar_sim.arm.planning.timing import ExternalLoad, Trajectory, find_trajectory, joined, resting
from cutgrammar_sim.arm.planning.transit import find_transit

TRAVEL = 0.4
"""Maximum speed of the tool in straight movements other than the press [m/s]."""


@dataclass(frozen=True, eq=False)
class Move:
    """The paths of one phase, in their order; `speed` limits the tool where its path is straight [m/s]."""

    phase: str
    paths: tuple[Path, ...]
    speed: float = TRAVEL
    gripper_out: bool = False
    holds: bool = False


@dataclass(frozen=True, eq=False)
class Carry:
    """A fragment is picked up, turned if needed, and set down in another place, where it is held until the cut is made.

    Attributes:
        fragment: its index in the configuration.
        X_GF: the fragment in the gripper.
        X_WF: its pose once it is set down.
        why: the reason, in words.
        turned_deg: angle between its poses before and after, without the turn about the vertical [degrees].
    """

    fragment: int
    X_GF: Pose
    X_WF: Pose
    why: str
    turned_deg: float = 0.0


@dataclass(frozen=True, eq=False)
class Leg:
    """One movement of the arm, from rest to rest, in which the same things are fixed to it.

    Attributes:
        phase: "transit", "pick", "carry", "place", "approach", "press" or "retreat".
        trajectory: of the joints.
        gripper_out: whether the gripper is extended.
        carry: what the gripper holds in it, if anything.
    """

    phase: str
    trajectory: Trajectory
    gripper_out: bool = False
    carry: Carry | None = None


def carrying_moves(
    rig: Rig, to_it: tuple[Path, ...], hold: Hold, X_WF: Pose, q: Floats, others: PlanningScene
) -> tuple[Move, ...] | None:
    """The movements that take hold of a fragment and set it down at X_WF; None if something is in the way.

    Args:
        rig: the arm with its tool.
        to_it: paths to above the fragment.
        hold: how it is taken hold of.
        X_WF: its pose afterwards.
        q: (n,) posture in which it is set down [rad].
        others: the other fragments, with the gripper extended.
    """
    placing = find_placing(rig, hold, X_WF, q, others)
    if placing is None:
        return None
    across = find_transit(rig.arm, hold.scene, hold.lift.waypoints[-1], placing.down.waypoints[0])
    if across is None:
        return None
    return (
        Move("transit", to_it, gripper_out=True),
        Move("pick", (hold.down,), gripper_out=True),
        Move("carry", (hold.lift, *across), gripper_out=True, holds=True),
        Move("place", (placing.down,), gripper_out=True, holds=True),
        Move("retreat", (placing.away,), gripper_out=True),
    )


def timed(
    rig: Rig,
    moves: Sequence[Move],
    q_now: Floats,
    pushed: ExternalLoad | None = None,
    carry: Carry | None = None,
    carried: Fragment | None = None,
) -> tuple[Leg, ...] | Refused:
    """The movements with their times, each from where the one before ends; refused if the motors are too weak.

    Args:
        rig: the arm with its tool.
        moves: the movements.
        q_now: (n,) posture in which they begin [rad].
        pushed: the load in the press, if there is one.
        carry, carried: how the gripper carries a fragment, if it does, and that fragment.
    """
    laden = rig.unladen
    if carry is not None and carried is not None:
        held = load_of_fragment(carried.mesh, rig.tool.X_TG @ carry.X_GF, rig.density)
        laden = replace(rig.unladen, loads=(*rig.unladen.loads, held))
    legs, at = [], q_now
    for move in moves:
        load = laden if move.holds else rig.unladen
        if move.phase == "press" and pushed is not None:
            load = pushed
        parts = []
        for path in move.paths:
            onward = path.with_turns(nearest_turns(rig.arm, at, path.waypoints[0]))
            part = find_trajectory(rig.arm, onward, rig.limits, load, move.speed if path.metres else np.inf)
            if part is None:
                return Refused(f"the motors are too weak for the {move.phase}")
            parts.append(part)
            at = part.positions[-1]
        trajectory = joined(parts) if parts else resting(at)
        legs.append(Leg(move.phase, trajectory, move.gripper_out, carry if move.holds else None))
    return tuple(legs)
