"""Any serial arm from its URDF: the joints from the root to the link named as flange, with what is fixed to its links.

Pinocchio reads the description; what it would accept in silence or refuse without saying where is checked before, so
that every error is one line that names the element. Looks, transmissions and mesh files are not needed: a link that no
cylinder, sphere or box covers is covered by a capsule from its joint to the next. What is beyond the flange, such as a
gripper, is left out, for the tool takes its place.
"""

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
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

GUESSED_RADIUS = 0.05
"""Radius of the capsule that covers a link whose shape is not given [m]."""
MIN_JOINTS, MAX_JOINTS = 6, 10
"""Joints of an arm: with fewer not every pose can be reached."""
MAX_STRIPS = 6
"""Capsules that cover one box."""
NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
    "box": {"size": 3},
}
"""How many numbers the attributes of elements hold."""


def read_urdf(text: str, flange: str) -> Arm:
    """The arm that a URDF describes.

    Args:
        text: the URDF.
        flange: name of the link that the tool is fixed to; its z points out of the flange.

    Raises:
        InputError: the text is not XML or no robot, has no such link or no chain of revolute and continuous joints
            with limits from the root to it; a moving link has no mass; or the arm does not reach over the board.
    """
    robot = _parse(text)
    parents = _parents(robot, flange)
    chain = _chain(parents, flange)
    turning = [joint for joint in chain if joint.get("type") != "fixed"]
    if not MIN_JOINTS <= len(turning) <= MAX_JOINTS:
        raise InputError(
            f"{len(turning)} joints turn between the URDF's root and {flange!r}; "
            f"{MIN_JOINTS} to {MAX_JOINTS} are needed"
        )
    _prune(robot, parents, chain, flange)
    _check_numbers(robot)
    joints = [_joint(joint) for joint in turning]
    names = [_link_of(chain[0], "parent"), *(_link_of(joint, "child") for joint in turning)]
    return _arm(robot, joints, names, flange)


def _arm(robot: Element, joints: list[Joint], names: list[str], flange: str) -> Arm:
    """The arm of a checked description, with joints that have no place yet and the names of its links."""
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
    placed = [
        Joint(joint.name, X_PJ, joint.axis, joint.low, joint.high, joint.velocity, joint.torque)
        for joint, X_PJ in zip(joints, placements, strict=True)
    ]
    home = find_home(links, placed, X_LT)
    if home is None:
        raise InputError(
            f"the arm, its base 45 cm behind the board's middle and 5 cm under its top, does not bring {flange!r} over"
            " it with z downwards: it reaches too little, is too low, or z of that link does not point out of it"
        )
    return Arm(robot.get("name") or "arm", tuple(links), tuple(placed), X_LT, home)


def _parse(text: str) -> Element:
    """The element <robot>; a document type declaration, with which a file can grow without bounds, is refused."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError("the URDF has a document type declaration, which none needs; remove it")
    try:
        robot = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"the URDF is not XML: {error}") from None
    if robot.tag != "robot":
        raise InputError(f"the URDF's first element is <{robot.tag}>; <robot> is expected")
    return robot


def _parents(robot: Element, flange: str) -> dict[str, Element]:
    """The joint above each link, by the link's name."""
    names = [_name(link) for link in robot.findall("link")]
    if flange not in names:
        if any("xacro" in element.tag for element in robot):
            raise InputError("the URDF is a xacro file, which is a program that writes one; expand it first")
        raise InputError(f"the URDF has no link {flange!r} to fix the tool to; its links: {', '.join(names) or 'none'}")
    parents: dict[str, Element] = {}
    for joint in robot.findall("joint"):
        for end in ("parent", "child"):
            if _link_of(joint, end) not in names:
                link = _link_of(joint, end) or None
                raise InputError(f"the {end} of joint {_name(joint)!r} is {link!r}, which is no link of the URDF")
        child = _link_of(joint, "child")
        if child in parents:
            raise InputError(f"link {child!r} has two parents, {_name(parents[child])!r} and {_name(joint)!r}")
        parents[child] = joint
    return parents


def _chain(parents: dict[str, Element], flange: str) -> list[Element]:
    """The joints from the root to the link `flange`."""
    chain: list[Element] = []
    at = flange
    while at in parents:
        joint = parents[at]
        if joint in chain:
            raise InputError(f"the URDF's links go round in a circle at {at!r}")
        if joint.get("type") not in ("revolute", "continuous", "fixed"):
            raise InputError(
                f"joint {_name(joint)!r} is {joint.get('type')!r}; only revolute, continuous and fixed ones can be used"
            )
        if joint.find("mimic") is not None:
            raise InputError(f"joint {_name(joint)!r} mimics another; each joint must have a motor")
        chain.append(joint)
        at = _link_of(joint, "parent")
    if not chain:
        raise InputError(f"link {flange!r} is the URDF's root; the last link of an arm is expected")
    return chain[::-1]


def _prune(robot: Element, parents: dict[str, Element], chain: list[Element], flange: str) -> None:
    """Remove all that the arm does not need: what is beyond the flange, what only looks like something, and meshes."""
    on_chain = {_link_of(chain[0], "parent"), *(_link_of(joint, "child") for joint in chain)}
    kept = set(on_chain)
    grown = True
    while grown:
        grown = False
        for child, joint in parents.items():
            parent = _link_of(joint, "parent")
            if child in kept or parent == flange or parent not in kept:
                continue
            if joint.get("type") != "fixed":
                raise InputError(f"joint {_name(joint)!r} branches off the arm at {parent!r}; a chain is needed")
            kept.add(child)
            grown = True
    for element in list(robot):
        name = {"link": element.get("name"), "joint": _link_of(element, "child")}.get(element.tag)
        if name not in kept:
            robot.remove(element)
    for link in robot.findall("link"):
        for part in [*link.findall("visual"), *link.findall("collision")]:
            if part.tag == "visual" or part.find("geometry/mesh") is not None:
                link.remove(part)


def _check_numbers(robot: Element) -> None:
    """Refuse attributes that are missing, not numbers, or not above zero where they must be."""
    for owner in robot:
        for element in owner.iter():
            what = f"<{element.tag}> of {owner.tag} {owner.get('name')!r}"
            if element.tag == "inertial" and (element.find("mass") is None or element.find("inertia") is None):
                raise InputError(f"{what} is not complete: <mass> and <inertia> are needed")
            for name, count in NUMBERS.get(element.tag, {}).items():
                if element.get(name) is None and element.tag in ("origin", "axis"):
                    continue
                values = _numbers(element, name, count, what)
                if element.tag in ("cylinder", "sphere", "box") and (values <= 0.0).any():
                    raise InputError(f"{what} has {name} {element.get(name)!r}; it must be above zero")
                if element.tag == "mass" and values[0] < 0.0:
                    raise InputError(f"{what} is {values[0]:g} kg")


def _joint(joint: Element) -> Joint:
    """A joint that turns, its place in the link before it still to be found."""
    name, what = _name(joint), f"joint {_name(joint)!r}"
    axis_of = joint.find("axis")
    axis = np.array([1.0, 0.0, 0.0]) if axis_of is None else _numbers(axis_of, "xyz", 3, f"the axis of {what}")
    length = float(np.linalg.norm(axis))
    if length < 1e-6:
        raise InputError(f"the axis of {what} has length zero")
    limit = joint.find("limit")
    if limit is None:
        raise InputError(f"{what} has no <limit>; velocity, effort and, if it is revolute, its range are needed")
    low, high = -math.inf, math.inf
    if joint.get("type") == "revolute":
        low, high = (float(_numbers(limit, bound, 1, what)[0]) for bound in ("lower", "upper"))
        if not low < high:
            raise InputError(f"{what} ranges from {low:g} to {high:g}; the upper limit must be the larger")
    velocity, torque = (float(_numbers(limit, bound, 1, what)[0]) for bound in ("velocity", "effort"))
    if velocity <= 0.0 or torque <= 0.0:
        raise InputError(f"{what} has velocity {velocity:g} and effort {torque:g}; both must be above zero")
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


def _name(element: Element) -> str:
    name = element.get("name")
    if not name:
        raise InputError(f"a <{element.tag}> of the URDF has no name")
    return name


def _link_of(joint: Element, end: str) -> str:
    """Name of a joint's parent or child, empty where it has none."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _numbers(element: Element, name: str, count: int, what: str) -> Floats:
    """(count,) finite numbers of an attribute."""
    text = element.get(name)
    try:
        numbers = np.array([float(number) for number in (text or "").split()])
    except ValueError:
        numbers = np.full(count, math.nan)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise InputError(f"{what} has {name} {text!r}; {'three numbers are' if count == 3 else 'a number is'} expected")
    return numbers
