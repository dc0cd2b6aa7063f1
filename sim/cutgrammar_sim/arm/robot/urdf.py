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
    links_fixed_beside,
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


MAX_OFF_AXIS = math.radians(45.0)
"""Largest angle between z of the flange and the axis of the last joint: beyond it the knife is mounted sideways."""

MIN_AHEAD = 0.01
"""Distance of the flange from the joint before the last, along the last axis, from which it tells what is out [m]."""


def read_urdf(text: str, flange: str) -> Arm:
    """The arm that a URDF describes.

    Args:
        text: the URDF.
        flange: name of the link that the tool is fixed to; its z points out of the flange.

    Raises:
        InputError: the text is not XML or no robot, has no such link or no chain of revolute and continuous joints
            with limits from the root to it; a moving link has no mass; the arm does not reach over the board, or the
            knife would be mounted sideways. The last two name links to which a tool can be fixed instead.
    """
    try:
        return _read(text, flange)
    except MisplacedToolError as error:
        fitting = [name for name in links_fixed_beside(text, flange) if _takes_tool(text, name)]
        advice = (
            f"it can be fixed to {' or '.join(map(repr, fitting))}"
            if fitting
            else ("no link that is fixed beside it fits, so add one whose z points out of the arm's end")
        )
        raise InputError(f"{error}; {advice}") from None


class MisplacedToolError(InputError):
    """A tool on this link of the arm cannot be used."""


def _takes_tool(text: str, flange: str) -> bool:
    try:
        _read(text, flange)
    except InputError:
        return False
    return True


def _read(text: str, flange: str) -> Arm:
    """The arm, if a tool on the link `flange` can be used."""
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
    _check_direction(placed[-1], X_LT, flange)
    home = find_home(links, placed, X_LT)
    if home is None:
        raise MisplacedToolError(
            f"the arm, its base 45 cm behind the board's middle and 5 cm under its top, does not bring {flange!r} over"
            " it with z downwards: it reaches too little, is too low, or z of that link does not point out of it"
        )
    return Arm(robot.get("name") or "arm", tuple(links), tuple(placed), X_LT, home)


def _check_direction(last: Joint, X_LT: Pose, flange: str) -> None:
    """Refuse a flange whose z points to the side of the last joint's axis, or back along it.

    Where the flange is along the axis, seen from the joint before, tells which way is out; the axis itself has either.
    """
    z_L, ahead_L = X_LT.rotation[:, 2], X_LT.position + last.X_PJ.rotation.T @ last.X_PJ.position
    along = float(z_L @ last.axis)
    if abs(along) < math.cos(MAX_OFF_AXIS):
        off = math.degrees(math.acos(abs(along)))
        raise MisplacedToolError(
            f"the knife would be mounted sideways: z of {flange!r} is {off:.0f} degrees off the axis of the last "
            f"joint, {last.name!r}"
        )
    if math.copysign(1.0, along) * float(last.axis @ ahead_L) < -MIN_AHEAD:
        raise MisplacedToolError(f"the knife would point into the arm: z of {flange!r} points back at {last.name!r}")


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
