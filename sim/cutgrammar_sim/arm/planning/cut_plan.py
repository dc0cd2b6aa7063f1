"""How the arm makes one cut, planned before anything moves.

The blade is pressed where the fragment lies, if that is possible; else the gripper carries the fragment to a free
place, turned if the plane lies too flat, and the blade is pressed there. What lies on the fragment is set aside first
(see `clearing`). Candidates are tried in a fixed order, and the first plan of which every part is possible is taken. A
plan depends on its arguments alone; no simulator takes part.

Frames: W the world, F a fragment, B the blade, G the gripper when extended (see `tool`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Refused
from cutgrammar_sim.arm.planning.carrying import Hold, find_holds, fragments_on_top, posture_to_place
from cutgrammar_sim.arm.planning.clearing import clear
from cutgrammar_sim.arm.planning.legs import Carry, Leg, Move, carrying_moves, timed
from cutgrammar_sim.arm.planning.paths import Path
from cutgrammar_sim.arm.planning.pressing import Press, find_presses, reaches
from cutgrammar_sim.arm.planning.rig import Rig
from cutgrammar_sim.arm.planning.scene import PlanningScene
from cutgrammar_sim.arm.planning.strokes import Stroke, find_strokes
from cutgrammar_sim.arm.planning.timing import ExternalLoad
from cutgrammar_sim.arm.planning.transit import find_transit
from cutgrammar_sim.arm.planning.turning import find_grasps, find_spots, find_turns
from cutgrammar_sim.physics.section import section

MAX_TURNS, MAX_GRASPS, MAX_SPOTS = 12, 16, 96
"""How many of each are tried."""
MAX_PLACES = 1000
"""Ways to set a fragment down that are tried for one cut, over all turns and grasps."""
MAX_WEAK = 8
"""Places at which the motors are too weak, after which no more are tried."""


@dataclass(frozen=True, eq=False)
class CutPlan:
    """All movements of a cut, in their order; the first begins where the arm is, the last ends at home.

    For every carry they are: transit, pick, carry, place (the fragment is held in the last two), retreat; then transit,
    approach, press, retreat, transit. The gripper closes at the end of "pick" and opens at the end of "place".

    Attributes:
        legs: the movements; each begins in the posture in which the one before it ends.
        meant: indices of the fragments that are cut, ascending.
        plane_W: cutting plane in W when the blade is pressed: the plane asked for, moved with the fragment carried.
        X_WB: the blade when its edge has reached the board; along x of B is plus or minus the plane's normal.
        carries: how fragments are moved before, in their order: first those that are set aside, then the one that is
            cut, unless it is cut where it lies.
    """

    legs: tuple[Leg, ...]
    meant: tuple[int, ...]
    plane_W: Plane
    X_WB: Pose
    carries: tuple[Carry, ...] = ()

    @property
    def carry(self) -> Carry | None:
        """How the fragment that is cut is moved before; None if it is cut where it lies."""
        return self.carries[-1] if self.carries and self.carries[-1].fragment in self.meant else None

    @property
    def set_aside(self) -> tuple[int, ...]:
        """Indices of the fragments that are set aside, in their order."""
        return tuple(carry.fragment for carry in self.carries if carry.fragment not in self.meant)


def plan_cut(
    now: Configuration, meant: tuple[int, ...], plane_W: Plane, rig: Rig, q_now: Floats, force: float = 0.0
) -> CutPlan | Refused:
    """Plan how the arm divides the fragments `meant` by `plane_W`, or say why it cannot.

    Args:
        now: the true fragments, meshes, in W, at rest.
        meant: indices of those to cut, ascending; the plane crosses each. Several are cut only where they lie.
        plane_W: cutting plane.
        rig: the arm with its tool.
        q_now: (n,) current posture of the arm [rad].
        force: maximum force of the food that is expected on the blade, against its movement [N].
    """
    q_now = np.asarray(q_now, dtype=np.float64)
    scene = PlanningScene(rig.checker, now)
    strokes = find_strokes(now, meant, plane_W, rig.tool, rig.max_tilt)
    if isinstance(strokes, Refused):
        why = strokes.reason
    else:
        found = _find_pressing(rig, strokes, scene, q_now)
        if found is not None:
            press, moves = found
            legs = timed(rig, moves, q_now, _pushed(rig, now, meant, plane_W, press, force))
            if isinstance(legs, Refused):
                return legs
            return CutPlan(legs, meant, plane_W, press.stroke.X_WB)
        if any(reaches(rig, stroke) for stroke in strokes):
            why = "the arm cannot press there without touching something"
        else:
            why = "it is out of the arm's reach"
    if len(meant) > 1:
        return Refused(f"{why}; several fragments at once are cut only where they lie")
    if not fragments_on_top(now[meant[0]], now):
        return _plan_carry(_Task(rig, now, meant[0], plane_W, q_now, force), why)
    cleared = clear(now, meant[0], rig, q_now)
    if isinstance(cleared, Refused):
        return Refused(f"{why}, and {cleared.reason}")
    plan = plan_cut(cleared.now, meant, plane_W, rig, cleared.legs[-1].trajectory.positions[-1], force)
    if isinstance(plan, Refused):
        return plan
    return replace(plan, legs=cleared.legs + plan.legs, carries=cleared.carries + plan.carries)


@dataclass(frozen=True, eq=False)
class _Task:
    """A cut of the fragment `now[index]`; the other fields are the arguments of `plan_cut`."""

    rig: Rig
    now: Configuration
    index: int
    plane_W: Plane
    q_now: Floats
    force: float

    @property
    def fragment(self) -> Fragment:
        """The fragment that is cut, as it lies."""
        return self.now[self.index]

    @property
    def others(self) -> Configuration:
        """All other fragments."""
        return tuple(fragment for i, fragment in enumerate(self.now) if i != self.index)


def _find_pressing(
    rig: Rig, strokes: Sequence[Stroke], scene: PlanningScene, q_from: Floats
) -> tuple[Press, list[Move]] | None:
    """The first stroke that the arm can make and reach, and all movements from `q_from` (n,) by it to home."""
    for press in find_presses(rig, strokes, scene):
        above = press.down.waypoints[0]
        outward = find_transit(rig.arm, scene, q_from, above)
        home = None if outward is None else find_transit(rig.arm, scene, above, np.asarray(rig.arm.home))
        if outward is not None and home is not None:
            down = press.down
            return press, [
                Move("transit", outward),
                Move("approach", (down.part(0.0, press.begins),)),
                Move("press", (down.part(press.begins, down.length),), rig.press_speed),
                Move("retreat", (down.reversed(),)),
                Move("transit", home),
            ]
    return None


def _plan_carry(task: _Task, why: str) -> CutPlan | Refused:
    """The first plan that carries the fragment to a place where it can be cut, and cuts it there.

    Args:
        task: the cut.
        why: the reason why it cannot be made where the fragment lies.
    """
    rig, fragment, plane_W = task.rig, task.fragment, task.plane_W
    everything = PlanningScene(rig.checker, task.now, gripper_out=True)
    others = PlanningScene(rig.checker, task.others, gripper_out=True)
    turns = find_turns(fragment, plane_W, rig.tool, rig.max_tilt)
    if not turns:
        return Refused(f"{why}, and turned so that the plane stands it would not fit under the blade")
    held, weak, tried = False, 0, 0
    for turn in turns[:MAX_TURNS]:
        for hold in find_holds(rig, fragment, islice(find_grasps(fragment, turn), MAX_GRASPS), others):
            held = True
            to_it = find_transit(rig.arm, everything, task.q_now, hold.down.waypoints[0])
            if to_it is None:
                continue
            for X_WF in islice(find_spots(fragment, turn, plane_W, rig.tool, others.footprint), MAX_SPOTS):
                if tried == MAX_PLACES:
                    return Refused(f"{why}, and of {MAX_PLACES} ways to set it down none lets it be cut")
                tried += 1
                plan = _carried_to(task, why, others, hold, X_WF, to_it)
                if isinstance(plan, CutPlan):
                    return plan
                if plan is not None:
                    weak += 1
                    if weak == MAX_WEAK:
                        return Refused(f"{why}, and where it could be set down {plan.reason}")
    if not held:
        return Refused(f"{why}, and the gripper finds no way to take hold of it")
    return Refused(f"{why}, and no place is found where it could be set down and cut")


def _carried_to(
    task: _Task, why: str, others: PlanningScene, hold: Hold, X_WF: Pose, to_it: tuple[Path, ...]
) -> CutPlan | Refused | None:
    """The plan that sets the fragment down at X_WF: refused if a motor is too weak, None if something is in the way."""
    rig, fragment, index = task.rig, task.fragment, task.index
    q = posture_to_place(rig, hold, X_WF, others)
    if q is None:
        return None
    X_move = X_WF @ fragment.X_WF.inverse()  # of the fragment in W
    plane_then = task.plane_W.transformed(X_move)
    then = tuple(Fragment(f.shape, X_WF) if i == index else f for i, f in enumerate(task.now))
    strokes = find_strokes(then, (index,), plane_then, rig.tool, rig.max_tilt)
    if isinstance(strokes, Refused):
        return None
    carrying = carrying_moves(rig, to_it, hold, X_WF, q, others)
    if carrying is None:
        return None
    away = carrying[-1].paths[-1].waypoints[-1]
    found = _find_pressing(rig, strokes, PlanningScene(rig.checker, then), away)
    if found is None:
        return None
    press, moves = found
    turned = float(np.degrees(np.arccos(np.clip(X_move.rotation[2, 2], -1.0, 1.0))))
    carry = Carry(index, hold.X_GF, X_WF, why, turned)
    pushed = _pushed(rig, then, (index,), plane_then, press, task.force)
    legs = timed(rig, [*carrying, *moves], task.q_now, pushed, carry, fragment)
    if isinstance(legs, Refused):
        return legs
    return CutPlan(legs, (index,), plane_then, press.stroke.X_WB, (carry,))


def _pushed(
    rig: Rig, now: Configuration, meant: tuple[int, ...], plane_W: Plane, press: Press, force: float
) -> ExternalLoad:
    """The load on the arm in the press: its tool, and the force on the edge in the middle of the section."""
    X_WB = press.stroke.X_WB
    along = np.concatenate([section(now[i], plane_W).reshape(-1, 3) for i in meant]) - X_WB.position
    middle = along @ X_WB.rotation[:, 1]
    p_BP = np.array([0.0, (middle.min() + middle.max()) / 2.0, 0.0])
    return replace(rig.unladen, force_W=force * X_WB.rotation[:, 2], p_TP=rig.tool.X_TB.apply(p_BP))
