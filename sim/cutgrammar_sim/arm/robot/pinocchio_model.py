"""An arm as Pinocchio sees it: built once from its figures, then kept for all that is computed about it.

An `Arm` is plain data, which travels between processes; its Pinocchio model is rebuilt where it is needed. Every joint
has one angle, also a joint that turns without end.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import coal
import numpy as np
import pinocchio

from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.robot.description import X_WA, Arm, Capsule


@dataclass(frozen=True, eq=False)
class ArmModel:
    """A Pinocchio model with its workspace; each call overwrites the workspace.

    Attributes:
        model: a `pinocchio.Model`.
        data: its `pinocchio.Data`.
        last: index of the last joint.
        X_LT: the flange in the last link, as `pinocchio.SE3`.
    """

    model: Any
    data: Any
    last: int
    X_LT: Any


@lru_cache(maxsize=16)
def model_of(arm: Arm) -> ArmModel:
    """The Pinocchio model of `arm`, without any load."""
    model = pinocchio.Model()
    model.name = arm.name
    for joint, link in zip(arm.joints, arm.links[1:], strict=True):
        number = model.addJoint(
            model.njoints - 1, pinocchio.JointModelRevoluteUnaligned(joint.axis), to_se3(joint.X_PJ), joint.name
        )
        inertia = pinocchio.Inertia(link.mass, link.p_LC, link.inertia)
        model.appendBodyToJoint(number, inertia, pinocchio.SE3.Identity())
    return ArmModel(model, model.createData(), model.njoints - 1, to_se3(arm.X_LT))


def to_se3(X_AB: Pose) -> Any:
    """A pose as `pinocchio.SE3`."""
    return pinocchio.SE3(X_AB.rotation, X_AB.position)


def link_capsules(arm: Arm) -> list[tuple[int, Any]]:
    """The capsules that cover an arm's links, each with the index of its link, as `pinocchio.GeometryObject`."""
    robot = model_of(arm)
    return [(i, capsule_object(robot, i, capsule)) for i, link in enumerate(arm.links) for capsule in link.capsules]


def board_object(robot: ArmModel) -> Any:
    """The board as `pinocchio.GeometryObject`: the half space under z = 0 of W."""
    board = coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
    return shape_object(robot, "board", 0, board, to_se3(X_WA.inverse()))


def capsule_object(robot: ArmModel, link: int, capsule: Capsule) -> Any:
    """A capsule on a link as `pinocchio.GeometryObject`; the flange counts as one more link after the last."""
    a, b = capsule.ends
    length = float(np.linalg.norm(b - a))
    z = np.array([0.0, 0.0, 1.0])
    turn = pinocchio.Quaternion.FromTwoVectors(z, (b - a) / length if length > 1e-9 else z).toRotationMatrix()
    shape = coal.Capsule(capsule.radius, length)
    return shape_object(robot, f"capsule of link {link}", link, shape, pinocchio.SE3(turn, (a + b) / 2.0))


def shape_object(robot: ArmModel, name: str, link: int, shape: Any, X_LS: Any) -> Any:
    """A coal shape at X_LS on a link as `pinocchio.GeometryObject`; the flange is one more link after the last."""
    joint = min(link, robot.last)
    return pinocchio.GeometryObject(name, joint, robot.X_LT * X_LS if link > robot.last else X_LS, shape)
