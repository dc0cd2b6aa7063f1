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
from cutgrammar_sim.arm.robot.description import X_WA, Arm
from cutgrammar_sim.arm.robot.pinocchio_model import (
    ArmModel,
    board_object,
    capsule_object,
    link_capsules,
    model_of,
    shape_object,
    to_se3,
)
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


class CollisionChecker:
    """The collision shapes of an arm with its tool."""

    def __init__(self, arm: Arm, tool: Tool) -> None:
        self._arm = arm
        self._robot = robot = model_of(arm)
        self._flange = flange = len(arm.links)
        parts = link_capsules(arm)
        middle = Pose(np.eye(3), np.array([0.0, 0.0, tool.height / 2.0]))
        box = coal.Box(max(tool.thickness, 1e-4), tool.length, tool.height)
        knife = [
            (flange, shape_object(robot, "blade", flange, box, to_se3(tool.X_TB @ middle))),
            (flange, capsule_object(robot, flange, tool.handle)),
        ]
        self._knife = [shape for link, shape in [*knife, *parts] if link >= flange - 1]
        self._parts: dict[bool, list[tuple[int, Any]]] = {}
        self._pairs: dict[bool, list[tuple[int, int]]] = {}
        for gripper_out in (False, True):
            gripper = capsule_object(robot, flange, tool.gripper_out if gripper_out else tool.gripper_in)
            self._parts[gripper_out] = [*parts, (flange, gripper), *knife]
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
            fragments: on the board.
            margin: distance to keep from them and from the board [m].
            gripper_out: whether the gripper is extended.
            blade: whether the blade, too, keeps clear of fragments and board.
            held: the fragment that the gripper carries, which must not touch anything else either.
        """
        parts = self._parts[gripper_out]
        geometry = _geometry(parts)
        pairs = [(a, b, CLEARANCE) for a, b in self._pairs[gripper_out]]
        moving = [
            i for i, (link, shape) in enumerate(parts) if link >= FIRST_MOVING and (blade or shape.name != "blade")
        ]
        if held is not None:
            hull = shape_object(self._robot, "held", self._flange, collision_hull(held.mesh), to_se3(held.pose))
            carried = geometry.addGeometryObject(hull)
            # the last link and the tool move with it; see `is_clear_of_knife`
            pairs += [(i, carried, CLEARANCE) for i, (link, _) in enumerate(parts) if link < self._flange - 1]
            moving.append(carried)
        X_AW = to_se3(X_WA.inverse())
        standing = [
            shape_object(self._robot, f"fragment {i}", 0, collision_hull(body.mesh), X_AW * to_se3(body.pose))
            for i, body in enumerate(fragments)
        ]
        for shape in (board_object(self._robot), *standing):
            obstacle = geometry.addGeometryObject(shape)
            pairs += [(part, obstacle, margin) for part in moving]
        return CollisionScene(self._robot, geometry, pairs)

    def is_clear_of_knife(self, held: Body) -> bool:
        """Whether a fragment that the gripper holds is clear of the knife and of the last link."""
        hull, X_LF = collision_hull(held.mesh), self._robot.X_LT * to_se3(held.pose)
        request = coal.CollisionRequest()
        request.security_margin = CLEARANCE
        return not any(
            coal.collide(
                part.geometry, _transform(part.placement), hull, _transform(X_LF), request, coal.CollisionResult()
            )
            for part in self._knife
        )

    def _separable_pairs(self, parts: Sequence[tuple[int, Any]]) -> list[tuple[int, int]]:
        """The pairs of parts that can come apart and do when the arm is at home."""
        pairs = []
        for (a, (first, _)), (b, (second, _)) in combinations(enumerate(parts), 2):
            near = second - first <= 1 or (second == self._flange and first >= self._flange - 2)
            scene = CollisionScene(self._robot, _geometry(parts), [(a, b, CLEARANCE)])
            if not near and scene.is_free(self._arm.home[None]):
                pairs.append((a, b))
        return pairs


def _geometry(parts: Sequence[tuple[int, Any]]) -> Any:
    """A geometry model of parts, numbered in their order."""
    geometry = pinocchio.GeometryModel()
    for _, shape in parts:
        geometry.addGeometryObject(shape)
    return geometry


class CollisionScene:
    """An arm in a geometry model, with the pairs of shapes that must keep a distance from one another."""

    def __init__(self, robot: ArmModel, geometry: Any, pairs: Sequence[tuple[int, int, float]]) -> None:
        self._robot = robot
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
            pinocchio.computeCollisions(model, data, self._geometry, self._data, row, True) for row in np.atleast_2d(q)
        )


@lru_cache(maxsize=96)
def collision_hull(mesh: Mesh) -> Any:
    """The convex hull of a mesh in F as a `coal.Convex`."""
    points = coal.StdVec_Vec3s()
    points.extend(list(hull_of(mesh)[0]))
    return coal.ConvexBase.convexHull(points, True, "Qt")


def _transform(X: Any) -> Any:
    return coal.Transform3s(X.rotation, X.translation)
