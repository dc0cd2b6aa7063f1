"""The posture in which an arm waits while cameras look: knife down over the board, out of the cameras' sight.

It is found by inverse kinematics from the same few seeds every time; coal measures how far the arm is from itself, from
the board and from the lines of sight.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pinocchio
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.robot.collision import FIRST_MOVING
from cutgrammar_sim.arm.robot.description import X_WA, Arm, ArmLink, Capsule, Joint
from cutgrammar_sim.arm.robot.kinematics import solutions
from cutgrammar_sim.arm.robot.pinocchio_model import board_object, capsule_object, link_capsules, model_of
from cutgrammar_sim.arm.robot.tool import BACK

CAMERAS = np.array([[0.5, 0.0, 0.75], [-0.35, 0.6, 0.7]])
"""Positions of the cameras in W: in front of the board, and on its left [m]."""
SEEN = np.stack(np.meshgrid([-0.15, 0.0, 0.15], [-0.15, 0.0, 0.15], [0.0, 0.06]), axis=-1).reshape(-1, 3)
"""(k, 3) points over the board that they must see [m]."""
PLACES = tuple(itertools.product((0.47, 0.55), (-0.04, -0.12), (-0.1, -0.2, 0.0)))
"""z, x and y of the flange in W, in the order in which they are tried [m]."""
YAWS = (0.0, 90.0, -90.0, 180.0)
"""Angles of the knife about the vertical [degrees]."""
TOOL = Capsule(np.array([[0.0, 0.0, 0.02], [0.0, 0.0, 0.17]]), 0.04)
"""Knife and gripper, approximately, in T."""
GOOD_DISTANCE = 0.03
"""Distance from the lines of sight at which a posture is taken at once [m]."""
LEEWAY = 0.1
"""Distance that counts as much as a radian to the nearest limit of a joint [m]: motions should not start at a limit."""


def find_home(links: Sequence[ArmLink], joints: Sequence[Joint], X_LT: Pose) -> Floats | None:
    """A posture (n,) in which to wait; None if none brings the knife down over the board, free of board and arm."""
    arm = Arm("", tuple(links), tuple(joints), X_LT, np.zeros(len(joints)))
    distances, seeds = _Distances(arm), list(_seeds(arm))
    best: tuple[float, Floats] | None = None
    for z, x, y in PLACES:
        for yaw in YAWS:
            X_WT = Pose(Rotation.from_euler("z", yaw, degrees=True).as_matrix() @ BACK, np.array([x, y, z]))
            for q in solutions(arm, X_WA.inverse() @ X_WT, seeds):
                score = distances.score(q)
                if score >= GOOD_DISTANCE:
                    return q
                if score > (-math.inf if best is None else best[0]):
                    best = score, q
    return None if best is None else best[1]


def _seeds(arm: Arm) -> Iterator[Floats]:
    """Twelve postures spread over all that the joints can do (a Kronecker sequence)."""
    low, high = np.clip(arm.position_limits, -math.pi, math.pi).T
    ratios = np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0, 29.0])[: len(low)]
    for k in range(1, 13):
        yield low + (high - low) * np.modf(0.5 + k * ratios)[0]


class _Distances:
    """Distances of an arm's links and tool from one another, from the board and from the cameras' lines of sight."""

    def __init__(self, arm: Arm) -> None:
        self._arm, self._robot = arm, model_of(arm)
        flange = len(arm.links)
        self._geometry = pinocchio.GeometryModel()
        self._kinds: list[str] = []
        parts = [*link_capsules(arm), (flange, capsule_object(self._robot, flange, TOOL))]
        numbered = [(self._add(shape), i) for i, shape in parts]
        board = self._add(board_object(self._robot))
        lines = [Capsule(X_WA.inverse().apply(np.array(ends)), 0.0) for ends in itertools.product(SEEN, CAMERAS)]
        sight = [self._add(capsule_object(self._robot, 0, line)) for line in lines]
        for (a, i), (b, j) in itertools.combinations(numbered, 2):
            if j - i > 2:
                self._pair("tool" if j == flange else "self", a, b)
        for a, i in numbered:
            for line in sight:
                self._pair("sight", a, line)
            if i >= FIRST_MOVING:
                self._pair("board", a, board)
        self._data = pinocchio.GeometryData(self._geometry)

    def score(self, q: Floats) -> float:
        """How far a posture is from lines of sight and limits [m].

        The score is -inf where the arm touches the board or the tool. It is below -1 where links touch each other,
        which counts as the lesser fault: guessed shapes may overlap in every posture.
        """
        pinocchio.computeDistances(self._robot.model, self._robot.data, self._geometry, self._data, q)
        nearest = dict.fromkeys(("tool", "self", "sight", "board"), math.inf)
        for kind, result in zip(self._kinds, self._data.distanceResults, strict=True):
            nearest[kind] = min(nearest[kind], result.min_distance)
        if nearest["board"] < 0.0 or nearest["tool"] < 0.0:
            return -math.inf
        if nearest["self"] < 0.0:
            return nearest["self"] - 1.0
        low, high = self._arm.position_limits.T
        return min(nearest["sight"], LEEWAY * float(np.minimum(q - low, high - q).min()))

    def _add(self, shape: Any) -> int:
        return int(self._geometry.addGeometryObject(shape))

    def _pair(self, kind: str, a: int, b: int) -> None:
        self._geometry.addCollisionPair(pinocchio.CollisionPair(a, b))
        self._kinds.append(kind)
