"""How the arm gets from one posture to another without touching anything: the first way that is free.

Tried in this order: all joints straight; by way of home, and of both ends with the tool higher; and two trees of
postures that grow towards each other (RRT-Connect, Kuffner and LaValle 2000) with a stream of random numbers that is
always the same, whose way is then cut short. A way of several straight parts pauses between them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar_sim.arm.planning.height_map import Heights
from cutgrammar_sim.arm.planning.paths import Path, nearest_turns, straight
from cutgrammar_sim.arm.robot.collision import CollisionChecker
from cutgrammar_sim.arm.robot.description import Arm
from cutgrammar_sim.arm.robot.kinematics import flange_pose, inverse_kinematics

MARGIN = 6e-3
"""Kept from fragments and board on the way [m]."""
RAISED = (0.1, 0.2)
"""How much higher the tool passes on a way by raised ends [m]."""
GROWTHS = 150
"""Of the two trees."""
REACH = 0.4
"""By how much a tree grows at a time [rad]."""
ROOM = 1.0
"""How far beyond the two ends postures are drawn [rad]."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What the arm moves among, and with what in its hand.

    Attributes:
        clearance: of arm and tool.
        heights: what stands on the board.
        gripper_out: the gripper is come out.
        held: (k, 3) points in T of the fragment carried, None where none is [m].
    """

    clearance: CollisionChecker
    heights: Heights
    gripper_out: bool = False
    held: Floats | None = None

    def free(self, path: Path, margin: float = MARGIN, blade: bool = True) -> bool:
        """Whether nothing touches anywhere along `path`; see `CollisionChecker.free`."""
        return self.clearance.free(path.sampled(), self.heights, margin, self.gripper_out, blade, self.held)


def find_way(arm: Arm, around: Surroundings, q_from: Floats, q_to: Floats) -> tuple[Path, ...] | None:
    """Straight paths, one after another, from `q_from` (n,) to `q_to` (n,) give or take whole turns; or None."""
    if not (around.free(straight(q_from, q_from)) and around.free(straight(q_to, q_to))):
        return None
    goal = q_to + nearest_turns(arm, q_from, q_to)
    for between in ([], *_detours(arm, q_from, goal)):
        way = _legs(arm, [q_from, *between, q_to])
        if all(around.free(path) for path in way):
            return way
    grown = _grown(arm, around, q_from, goal)
    return None if grown is None else _legs(arm, grown)


def _legs(arm: Arm, postures: Sequence[Floats]) -> tuple[Path, ...]:
    """Straight paths through postures, each reached by the nearest turns."""
    at, legs = postures[0], []
    for posture in postures[1:]:
        to = posture + nearest_turns(arm, at, posture)
        if np.abs(to - at).max() > 1e-9:
            legs.append(straight(at, to))
        at = to
    return tuple(legs)


def _detours(arm: Arm, q_from: Floats, q_to: Floats) -> list[list[Floats]]:
    found: list[list[Floats]] = [[np.asarray(arm.home)]]
    for rise in RAISED:
        up_from, up_to = _raised(arm, q_from, rise), _raised(arm, q_to, rise)
        if up_from is not None and up_to is not None:
            found += [[up_from, up_to], [up_from, np.asarray(arm.home), up_to]]
    return found


def _raised(arm: Arm, q: Floats, rise: float) -> Floats | None:
    X_AT = flange_pose(arm, q)
    return inverse_kinematics(arm, type(X_AT)(X_AT.rotation, X_AT.position + np.array([0.0, 0.0, rise])), q)


def _grown(arm: Arm, around: Surroundings, q_from: Floats, q_to: Floats) -> list[Floats] | None:
    """Postures on a free way, found by two trees."""
    rng = np.random.default_rng(0)
    low = np.maximum(np.minimum(q_from, q_to) - ROOM, [joint.low for joint in arm.joints])
    high = np.minimum(np.maximum(q_from, q_to) + ROOM, [joint.high for joint in arm.joints])
    trees = [_Tree(q_from), _Tree(q_to)]
    for growth in range(GROWTHS):
        one, other = trees[growth % 2], trees[1 - growth % 2]
        new = one.grow(around, rng.uniform(low, high))
        if new is None:
            continue
        target, joint = one.postures[new], None
        while (last := other.grow(around, target)) is not None:
            if np.abs(other.postures[last] - target).max() < 1e-9:
                joint = last
                break
        if joint is not None:
            there, back = one.way(new), other.way(joint)
            way = there[::-1] + back[1:] if growth % 2 == 0 else back[::-1] + there[1:]
            return _shortened(around, way)
    return None


class _Tree:
    """Postures, each reached straight from its parent."""

    def __init__(self, root: Floats) -> None:
        self.postures = [root]
        self._parents = [-1]

    def grow(self, around: Surroundings, target: Floats) -> int | None:
        """Take one step from the nearest posture towards `target`; the new posture's number, None where it touches."""
        distances = np.linalg.norm(np.array(self.postures) - target, axis=1)
        nearest = int(np.argmin(distances))
        share = min(1.0, REACH / max(float(distances[nearest]), 1e-12))
        start = self.postures[nearest]
        new = target if share == 1.0 else start + share * (target - start)
        if not around.free(straight(start, new)):
            return None
        self.postures.append(new)
        self._parents.append(nearest)
        return len(self.postures) - 1

    def way(self, number: int) -> list[Floats]:
        """From a posture back to the root."""
        found = []
        while number >= 0:
            found.append(self.postures[number])
            number = self._parents[number]
        return found


def _shortened(around: Surroundings, way: list[Floats]) -> list[Floats]:
    """The same way with every part left out that can be."""
    short, at = [way[0]], 0
    while at < len(way) - 1:
        to = next(k for k in range(len(way) - 1, at, -1) if k == at + 1 or around.free(straight(way[at], way[k])))
        short.append(way[to])
        at = to
    return short
