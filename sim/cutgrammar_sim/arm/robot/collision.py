"""Whether an arm, its tool and what it carries touch anything, by coal through Pinocchio's geometry model.

Links and the tool's housing are capsules, the blade is a box, fragments are their convex hulls, the board is the half
space under z = 0 of W. Pairs that cannot come apart are left out: neighbouring links, the tool and the last two links,
and pairs that touch when the arm is at home.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Any

import coal
import numpy as np
import pinocchio

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.robot.description import X_WA, Arm, Capsule
from cutgrammar_sim.arm.robot.kinematics import as_postures
from cutgrammar_sim.arm.robot.pinocchio_model import model_of, to_se3
from cutgrammar_sim.arm.robot.tool import Tool
from cutgrammar_sim.physics.convex_hull import hull_of

FIRST_MOVING = 2
"""Links before this one stand behind the board, lower than its top, and are not checked against it or fragments."""
CLEARANCE = 2e-3
"""Smallest distance between two parts of the arm, the tool and what is carried [m]."""


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body in a scene, which counts as its convex hull.

    Attributes:
        mesh: its surface.
        pose: X_WF of a fragment on the board; X_TF of a fragment that the gripper holds.
    """

    mesh: Mesh
    pose: Pose


@dataclass(frozen=True, eq=False)
class _Part:
    """A collision shape that is fixed to link number `link`; the flange counts as one more link."""

    name: str
    link: int
    shape: Any
    X_LS: Any


class CollisionChecker:
    """The collision shapes of an arm with its tool."""

    def __init__(self, arm: Arm, tool: Tool) -> None:
        self._arm = arm
        self._robot = model_of(arm)
        self._flange = len(arm.links)
        blade = _Part("blade", self._flange, *_box(tool))
        covers = [(link.name, i, capsule) for i, link in enumerate(arm.links) for capsule in link.capsules]
        parts = [_Part(f"{name} {k}", i, *as_coal(capsule)) for k, (name, i, capsule) in enumerate(covers)]
        handle = _Part("handle", self._flange, *as_coal(tool.handle))
        self._knife = [blade, handle, *(part for part in parts if part.link == self._flange - 1)]
        self._parts: dict[bool, list[_Part]] = {}
        self._pairs: dict[bool, list[tuple[int, int]]] = {}
        for gripper_out in (False, True):
            gripper = _Part("gripper", self._flange, *as_coal(tool.gripper_out if gripper_out else tool.gripper_in))
            self._parts[gripper_out] = [*parts, handle, gripper, blade]
            self._pairs[gripper_out] = self._separable_pairs(self._parts[gripper_out])

    def scene(
        self,
        fragments: Sequence[Body],
        margin: float,
        gripper_out: bool = False,
        blade: bool = True,
        held: Body | None = None,
    ) -> "CollisionScene":
        """The arm among fragments on the board.

        Args:
            fragments: what lies on the board.
            margin: distance to keep from it and from the board [m].
            gripper_out: whether the gripper is extended.
            blade: whether the blade, too, keeps clear of fragments and board.
            held: a fragment that the gripper carries, and that must not touch anything else.
        """
        geometry, parts = pinocchio.GeometryModel(), self._parts[gripper_out]
        numbers = [self._add(geometry, part) for part in parts]
        pairs = [(numbers[a], numbers[b], CLEARANCE) for a, b in self._pairs[gripper_out]]
        moving = [
            number
            for number, part in zip(numbers, parts, strict=True)
            if part.link >= FIRST_MOVING and (blade or part.name != "blade")
        ]
        if held is not None:
            carried = self._add(geometry, _Part("held", self._flange, collision_hull(held.mesh), to_se3(held.pose)))
            near = (self._flange - 1, self._flange)  # they move with it; see `is_clear_of_knife`
            links = (number for number, part in zip(numbers, parts, strict=True) if part.link not in near)
            pairs += [(number, carried, CLEARANCE) for number in links]
            moving.append(carried)
        X_AW = to_se3(X_WA.inverse())
        obstacles = [("board", coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), X_AW)]
        obstacles += [
            (f"fragment {i}", collision_hull(body.mesh), X_AW * to_se3(body.pose)) for i, body in enumerate(fragments)
        ]
        for name, shape, X_AS in obstacles:
            number = geometry.addGeometryObject(pinocchio.GeometryObject(name, 0, X_AS, shape))
            pairs += [(part, number, margin) for part in moving]
        return CollisionScene(self._arm, geometry, pairs)

    def is_clear_of_knife(self, held: Body) -> bool:
        """Whether a fragment that the gripper holds is clear of the knife and of the last link."""
        hull, X_TF = collision_hull(held.mesh), to_se3(held.pose)
        request = coal.CollisionRequest()
        request.security_margin = CLEARANCE
        for part in self._knife:
            X_TS = part.X_LS if part.link == self._flange else self._robot.X_LT.inverse() * part.X_LS
            if coal.collide(part.shape, _transform(X_TS), hull, _transform(X_TF), request, coal.CollisionResult()):
                return False
        return True

    def _add(self, geometry: Any, part: _Part) -> int:
        """Add a part of the arm or tool to a geometry model; its number there."""
        joint = min(part.link, self._robot.last)
        X_JS = self._robot.X_LT * part.X_LS if part.link == self._flange else part.X_LS
        return int(geometry.addGeometryObject(pinocchio.GeometryObject(part.name, joint, X_JS, part.shape)))

    def _separable_pairs(self, parts: Sequence[_Part]) -> list[tuple[int, int]]:
        """The pairs of parts that can come apart and do when the arm is at home."""
        geometry = pinocchio.GeometryModel()
        numbers = [self._add(geometry, part) for part in parts]
        pairs = []
        for a, b in combinations(range(len(parts)), 2):
            first, second = parts[a].link, parts[b].link
            near = second - first <= 1 or (second == self._flange and first >= self._flange - 2)
            pair = (numbers[a], numbers[b], CLEARANCE)
            if not near and CollisionScene(self._arm, geometry.copy(), [pair]).is_free(self._arm.home):
                pairs.append((a, b))
        return pairs


class CollisionScene:
    """An arm in a geometry model, with the pairs of shapes that must keep a distance from one another."""

    def __init__(self, arm: Arm, geometry: Any, pairs: Sequence[tuple[int, int, float]]) -> None:
        self._arm = arm
        self._robot = model_of(arm)
        self._geometry = geometry
        for a, b, _ in pairs:
            geometry.addCollisionPair(pinocchio.CollisionPair(a, b))
        self._data = pinocchio.GeometryData(geometry)
        for request, (_, _, distance) in zip(self._data.collisionRequests, pairs, strict=True):
            request.security_margin = distance

    def is_free(self, q: Floats) -> bool:
        """Whether all pairs keep their distance in all of the postures q (t, n) [rad]."""
        model, data = self._robot.model, self._robot.data
        return not any(
            pinocchio.computeCollisions(model, data, self._geometry, self._data, row, True)
            for row in as_postures(self._arm, q)
        )


@lru_cache(maxsize=96)
def collision_hull(mesh: Mesh) -> Any:
    """The convex hull of a mesh in F as a `coal.Convex`."""
    points = coal.StdVec_Vec3s()
    points.extend(list(hull_of(mesh)[0]))
    return coal.ConvexBase.convexHull(points, True, "Qt")


def as_coal(capsule: Capsule) -> tuple[Any, Any]:
    """A capsule as a `coal.Capsule` and the pose of its frame, whose z is along it, as `pinocchio.SE3`."""
    a, b = capsule.ends
    length = float(np.linalg.norm(b - a))
    along = (b - a) / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
    turn = pinocchio.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along).toRotationMatrix()
    return coal.Capsule(capsule.radius, length), pinocchio.SE3(turn, (a + b) / 2.0)


def _box(tool: Tool) -> tuple[Any, Any]:
    """The blade as a `coal.Box`, and the pose of its middle in T."""
    middle = Pose(np.eye(3), np.array([0.0, 0.0, tool.height / 2.0]))
    return coal.Box(max(tool.thickness, 1e-4), tool.length, tool.height), to_se3(tool.X_TB @ middle)


def _transform(X: Any) -> Any:
    return coal.Transform3s(X.rotation, X.translation)
