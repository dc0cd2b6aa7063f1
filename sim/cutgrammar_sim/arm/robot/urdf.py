"""Any serial arm from its URDF: the joints from the root to the link named as flange, with what is fixed to its links.

Pinocchio reads the description after `urdf_elements` has checked it. Looks, transmissions and mesh files are not
needed: a link that no cylinder, sphere or box covers is covered by a capsule from its joint to the next. What is beyond
the flange, such as a gripper, is left out, for the tool takes its place.
"""

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import replace
from typing import Any
from xml.etree.ElementTree import Element

import coal
import numpy as np
import pinocchio

from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.robot.description import Arm, ArmLink, Capsule, Joint
from cutgrammar_sim.arm.robot.home import find_home
from cutgrammar_sim.arm.robot.urdf_elements import (
    chain_to,
    check_numbers,
    link_of,
    name_of,
    numbers_of,
    parents_of,
    parse,
    prune,
)

GUESSED_RADIUS = 0.05
"""Radius of the capsule that covers a link whose shape is not given [m]."""
MIN_JOINTS, MAX_JOINTS = 6, 10
"""Joints of an arm: with fewer not every pose can be reached."""
MAX_STRIPS = 6
"""Capsules that cover one box."""


def read_urdf(text: str, flange: str) -> Arm:
    """The arm that a URDF describes.

    Args:
        text: the URDF.
        flange: name of the link that the tool is fixed to; its z points out of the flange.

    Raises:
        InputError: the text is not XML or no robot, has no such link or no chain of revolute and continuous joints
            with limits from the root to it; a moving link has no mass; or the arm does not reach over the board.
    """
    robot = parse(text)
    parents = parents_of(robot, flange)
    chain = chain_to(parents, flange)
    turning = [joint for joint in chain if joint.get("type") != "fixed"]
    if not MIN_JOINTS <= len(turning) <= MAX_JOINTS:
        raise InputError(
            f"{len(turning)} joints turn between the URDF's root and {flange!r}; "
            f"{MIN_JOINTS} to {MAX_JOINTS} are needed"
        )
    prune(robot, parents, chain, flange)
    check_numbers(robot)
    joints = [_joint(joint) for joint in turning]
    names = [link_of(chain[0], "parent"), *(link_of(joint, "child") for joint in turning)]
    return _arm(robot, joints, names, flange)


def _arm(robot: Element, joints: list[Joint], names: list[str], flange: str) -> Arm:
    """The arm of a checked description, given its joints without X_PJ and the names of its links."""
    text = ElementTree.tostring(robot, encoding="unicode")
    try:
        model = pinocchio.buildModelFromXML(text)
        geometry = pinocchio.buildGeomFromUrdfString(model, text, pinocchio.GeometryType.COLLISION)
    except (RuntimeError, ValueError) as error:
        raise InputError(f"Pinocchio cannot read the URDF: {' '.join(str(error).split())}") from None
    X_LT = _pose(model.frames[model.getFrameId(flange, pinocchio.FrameType.BODY)].placement)
    placements = [_pose(X) for X in list(model.jointPlacements)[1:]]
    links = []
    for number, (name, X_next) in enumerate(zip(names, [*placements, X_LT], strict=True)):
        inertia = model.inertias[number]
        if number and (inertia.mass <= 0.0 or np.linalg.eigvalsh(inertia.inertia)[0] <= 0.0):
            raise InputError(f"link {name!r} moves and has no <inertial> with a mass and moments above zero")
        shapes = [shape for shape in geometry.geometryObjects if shape.parentJoint == number]
        capsules = tuple(capsule for shape in shapes for capsule in _capsules(shape.geometry, _pose(shape.placement)))
        covers = capsules or (_between_joints(X_next.position),)
        links.append(ArmLink(name, inertia.mass, inertia.lever.copy(), inertia.inertia.copy(), covers))
    placed = [replace(joint, X_PJ=X_PJ) for joint, X_PJ in zip(joints, placements, strict=True)]
    home = find_home(links, placed, X_LT)
    if home is None:
        raise InputError(
            f"the arm, its base 45 cm behind the board's middle and 5 cm under its top, does not bring {flange!r} over"
            " it with z downwards: it reaches too little, is too low, or z of that link does not point out of it"
        )
    return Arm(robot.get("name") or "arm", tuple(links), tuple(placed), X_LT, home)


def _joint(joint: Element) -> Joint:
    """A joint that turns, with the identity for X_PJ, which Pinocchio computes."""
    name, subject = name_of(joint), f"joint {name_of(joint)!r}"
    axis_of = joint.find("axis")
    axis = np.array([1.0, 0.0, 0.0]) if axis_of is None else numbers_of(axis_of, "xyz", 3, f"the axis of {subject}")
    length = float(np.linalg.norm(axis))
    if length < 1e-6:
        raise InputError(f"the axis of {subject} has length zero")
    limit = joint.find("limit")
    if limit is None:
        raise InputError(f"{subject} has no <limit>; velocity, effort and, if it is revolute, its range are needed")
    low, high = -math.inf, math.inf
    if joint.get("type") == "revolute":
        low, high = (float(numbers_of(limit, bound, 1, subject)[0]) for bound in ("lower", "upper"))
        if not low < high:
            raise InputError(f"{subject} ranges from {low:g} to {high:g}; the upper limit must be the larger")
    velocity, torque = (float(numbers_of(limit, bound, 1, subject)[0]) for bound in ("velocity", "effort"))
    if velocity <= 0.0 or torque <= 0.0:
        raise InputError(f"{subject} has velocity {velocity:g} and effort {torque:g}; both must be above zero")
    return Joint(name, Pose.identity(), axis / length, low, high, velocity, torque)


def _capsules(shape: Any, X_LS: Pose) -> Iterator[Capsule]:
    """Capsules in L that cover a cylinder, sphere or box."""
    if isinstance(shape, coal.Cylinder):
        half = np.array([0.0, 0.0, shape.halfLength])
        yield _around(X_LS.apply(np.array([-half, half])), shape.radius)
    elif isinstance(shape, coal.Sphere):
        yield Capsule(np.array([X_LS.position, X_LS.position]), shape.radius)
    elif isinstance(shape, coal.Box):
        half = np.asarray(shape.halfSide)
        thin, wide, long = np.argsort(half, kind="stable")
        count = min(math.ceil(half[wide] / half[thin]), MAX_STRIPS)
        strip = 2.0 * half[wide] / count
        for k in range(count):
            ends = np.zeros((2, 3))
            ends[:, long] = [-half[long], half[long]]
            ends[:, wide] = (k + 0.5) * strip - half[wide]
            yield _around(X_LS.apply(ends), math.hypot(strip, 2.0 * half[thin]) / 2.0)


def _between_joints(next_L: Floats) -> Capsule:
    """The capsule of a link whose shape is not given: from its joint to the next, rounded ends included."""
    length = float(np.linalg.norm(next_L))
    inset = min(GUESSED_RADIUS / length, 0.5) if length > 0.0 else 0.5
    return Capsule(np.outer([inset, 1.0 - inset], next_L), GUESSED_RADIUS)


def _around(ends: Floats, radius: float) -> Capsule:
    """The capsule that covers a cylinder: a tenth wider, so that it need not reach as far beyond the ends (2, 3)."""
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    inset = min(0.45 * radius, length / 2.0)
    return Capsule(ends + np.outer([inset, -inset], along / length), math.hypot(radius, inset))


def _pose(X: Any) -> Pose:
    return Pose(X.rotation, X.translation)
