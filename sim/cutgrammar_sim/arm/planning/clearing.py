"""How the arm sets aside what lies on a fragment, before it cuts or carries that fragment.

One fragment after another is lifted straight up and set down, not turned over, in the free place nearest to where it
lay; of those that lie on one another, the uppermost is the first.
"""

from dataclasses import dataclass
from itertools import islice

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.interfaces import Refused
from cutgrammar_sim.arm.planning.carrying import find_holds, fragments_on_top, posture_to_place
from cutgrammar_sim.arm.planning.legs import Carry, Leg, carrying_moves, timed
from cutgrammar_sim.arm.planning.rig import Rig
from cutgrammar_sim.arm.planning.scene import PlanningScene
from cutgrammar_sim.arm.planning.transit import find_transit
from cutgrammar_sim.arm.planning.turning import NO_TURN, find_grasps, find_spots_aside

MAX_GRASPS, MAX_SPOTS = 8, 48
"""How many of each are tried."""


@dataclass(frozen=True, eq=False)
class Cleared:
    """Fragments were set aside.

    Attributes:
        now: the configuration with them in their new places.
        legs: the movements, from where the arm was.
        carries: of the fragments, in their order.
    """

    now: Configuration
    legs: tuple[Leg, ...] = ()
    carries: tuple[Carry, ...] = ()


def clear(now: Configuration, index: int, rig: Rig, q_now: Floats) -> Cleared | Refused:
    """Set aside all that lies on a fragment, or say why that cannot be done.

    Args:
        now: the true fragments, meshes, in W.
        index: of the fragment.
        rig: the arm with its tool.
        q_now: (n,) current posture of the arm [rad].
    """
    done = Cleared(now)
    while on_top := fragments_on_top(done.now[index], done.now):
        if len(done.carries) == len(now):
            return Refused(f"fragment {on_top[0]} lies on it again and again")
        upper = _uppermost(done.now, on_top)
        at = done.legs[-1].trajectory.positions[-1] if done.legs else q_now
        moved = _set_aside(done.now, upper, f"it lay on fragment {index}", rig, at)
        if isinstance(moved, Refused):
            return moved
        carry, legs = moved
        after = Fragment(now[upper].shape, carry.X_WF)
        then = tuple(after if i == upper else fragment for i, fragment in enumerate(done.now))
        done = Cleared(then, (*done.legs, *legs), (*done.carries, carry))
    return done


def _uppermost(now: Configuration, among: tuple[int, ...]) -> int:
    """The first of `among` on which nothing lies, or of what lies on them; the first of all if they lie in a circle."""
    seen: set[int] = set()
    waiting = list(among)
    while waiting:
        index = waiting.pop(0)
        above = fragments_on_top(now[index], now)
        if not above:
            return index
        seen.add(index)
        waiting += [other for other in above if other not in seen and other not in waiting]
    return among[0]


def _set_aside(
    now: Configuration, index: int, why: str, rig: Rig, q_now: Floats
) -> tuple[Carry, tuple[Leg, ...]] | Refused:
    """How a fragment is carried to the first free place that the arm can reach."""
    fragment = now[index]
    everything = PlanningScene(rig.checker, now, gripper_out=True)
    others = PlanningScene(rig.checker, now[:index] + now[index + 1 :], gripper_out=True)
    held = False
    for hold in find_holds(rig, fragment, islice(find_grasps(fragment, NO_TURN), MAX_GRASPS), others):
        held = True
        to_it = find_transit(rig.arm, everything, q_now, hold.down.waypoints[0])
        if to_it is None:
            continue
        for X_WF in islice(find_spots_aside(fragment, others.footprint), MAX_SPOTS):
            q = posture_to_place(rig, hold, X_WF, others)
            moves = None if q is None else carrying_moves(rig, to_it, hold, X_WF, q, others)
            if moves is None:
                continue
            carry = Carry(index, hold.X_GF, X_WF, why)
            legs = timed(rig, moves, q_now, carry=carry, carried=fragment)
            if not isinstance(legs, Refused):
                return carry, legs
    if not held:
        return Refused(f"the gripper finds no way to take hold of fragment {index}, which lies on it")
    return Refused(f"no place is found where fragment {index}, which lies on it, could be set down")
