"""How the arm gets from one posture to another without touching anything: the first path that is free.

Tried in this order: all joints straight; by way of home, and of both ends with the tool higher; and two trees of
postures that grow towards each other (RRT-Connect, Kuffner and LaValle 2000) with the same random numbers every time,
whose path is then shortened. Between several straight parts the arm pauses.
"""

from collections.abc import Sequence

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.planning.paths import Path, nearest_turns, straight
from cutgrammar_sim.arm.planning.scene import PlanningScene
from cutgrammar_sim.arm.robot.description import Arm
from cutgrammar_sim.arm.robot.kinematics import flange_pose, inverse_kinematics

RAISED = (0.1, 0.2)
"""Heights by which the tool is raised at both ends of a detour [m]."""
MAX_GROWTHS = 150
"""Growths of the two trees after which the search ends."""
REACH = 0.4
"""Distance by which a tree grows at a time [rad]."""
ROOM = 1.0
"""How far beyond the two ends postures are drawn [rad]."""


def find_transit(arm: Arm, scene: PlanningScene, q_from: Floats, q_to: Floats) -> tuple[Path, ...] | None:
    """Straight paths, one after another, from `q_from` (n,) to `q_to` (n,) up to whole turns; None if none is found."""
    if not (scene.is_free(q_from) and scene.is_free(q_to)):
        return None
    goal = q_to + nearest_turns(arm, q_from, q_to)
    for between in ([], *_detours(arm, q_from, goal)):
        paths = _straight_parts(arm, [q_from, *between, q_to])
        if all(scene.is_path_free(path) for path in paths):
            return paths
    postures = _rrt_connect(arm, scene, q_from, goal)
    return None if postures is None else _straight_parts(arm, postures)


def _straight_parts(arm: Arm, postures: Sequence[Floats]) -> tuple[Path, ...]:
    """Straight paths through postures, each reached by the nearest turns."""
    at, parts = postures[0], []
    for posture in postures[1:]:
        to = posture + nearest_turns(arm, at, posture)
        if np.abs(to - at).max() > 1e-9:
            parts.append(straight(at, to))
        at = to
    return tuple(parts)


def _detours(arm: Arm, q_from: Floats, q_to: Floats) -> list[list[Floats]]:
    """Postures to pass on the way: home, and both ends with the tool raised."""
    found: list[list[Floats]] = [[np.asarray(arm.home)]]
    for rise in RAISED:
        up_from, up_to = _raised(arm, q_from, rise), _raised(arm, q_to, rise)
        if up_from is not None and up_to is not None:
            found += [[up_from, up_to], [up_from, np.asarray(arm.home), up_to]]
    return found


def _raised(arm: Arm, q: Floats, rise: float) -> Floats | None:
    X_AT = flange_pose(arm, q)
    return inverse_kinematics(arm, Pose(X_AT.rotation, X_AT.position + np.array([0.0, 0.0, rise])), q)


def _rrt_connect(arm: Arm, scene: PlanningScene, q_from: Floats, q_to: Floats) -> list[Floats] | None:
    """Postures on a free path, found by two trees."""
    rng = np.random.default_rng(0)
    low, high = arm.position_limits.T
    low = np.maximum(np.minimum(q_from, q_to) - ROOM, low)
    high = np.minimum(np.maximum(q_from, q_to) + ROOM, high)
    trees = [_Tree(q_from), _Tree(q_to)]
    for growth in range(MAX_GROWTHS):
        growing, other = trees[growth % 2], trees[1 - growth % 2]
        new = growing.grow(scene, rng.uniform(low, high))
        if new is None:
            continue
        target, met = growing.postures[new], None
        while (last := other.grow(scene, target)) is not None:
            if np.abs(other.postures[last] - target).max() < 1e-9:
                met = last
                break
        if met is not None:
            postures = [*growing.to_root(new)[::-1], *other.to_root(met)[1:]]
            return _shortened(scene, postures if growth % 2 == 0 else postures[::-1])
    return None


class _Tree:
    """Postures, each reached by a straight path from its parent."""

    def __init__(self, root: Floats) -> None:
        self.postures = [root]
        self._parents = [-1]

    def grow(self, scene: PlanningScene, target: Floats) -> int | None:
        """Take one step from the nearest posture towards `target`; index of the new posture, None where it touches."""
        distances = np.linalg.norm(np.array(self.postures) - target, axis=1)
        nearest = int(np.argmin(distances))
        share = min(1.0, REACH / max(float(distances[nearest]), 1e-12))
        start = self.postures[nearest]
        new = target if share == 1.0 else start + share * (target - start)
        if not scene.is_path_free(straight(start, new)):
            return None
        self.postures.append(new)
        self._parents.append(nearest)
        return len(self.postures) - 1

    def to_root(self, number: int) -> list[Floats]:
        """The postures from one of them back to the root."""
        found = []
        while number >= 0:
            found.append(self.postures[number])
            number = self._parents[number]
        return found


def _shortened(scene: PlanningScene, postures: list[Floats]) -> list[Floats]:
    """The same path without the postures that straight paths can skip."""
    kept, at = [postures[0]], 0
    while at < len(postures) - 1:
        to = next(
            k
            for k in range(len(postures) - 1, at, -1)
            if k == at + 1 or scene.is_path_free(straight(postures[at], postures[k]))
        )
        kept.append(postures[to])
        at = to
    return kept
