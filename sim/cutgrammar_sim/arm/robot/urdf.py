"""Any serial arm from its URDF: the joints from the root to the link named as flange, with what is fixed to its links.

What a URDF says of looks and transmissions is not needed, nor are its mesh files: a link that no cylinder, sphere or
box covers is covered by a capsule from its joint to the next. What is beyond the flange, such as a gripper, gives way
to the tool.
"""

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.robot.description import Arm, ArmLink, Capsule, Joint
from cutgrammar_sim.arm.robot.home import home_of

RADIUS = 0.05
"""Of the capsule about a link whose shape is not given [m]."""
FEWEST, MOST = 6, 10
"""Joints of an arm: fewer do not reach every pose, more are no arm."""


def read_urdf(text: str, flange: str) -> Arm:
    """The arm that a URDF describes.

    Args:
        text: of the URDF.
        flange: name of the link that the tool is fixed to; its z points out of the flange.

    Raises:
        InputError: not XML, no robot, no such link, no chain of revolute and continuous joints with limits from the
            root to it, a moving link without mass, or an arm that does not reach over the board.
    """
    robot = _parsed(text)
    names = [_name(link) for link in robot.findall("link")]
    if flange not in names:
        if any("xacro" in element.tag for element in robot):
            raise InputError("the URDF is a xacro file, which is a program that writes one; expand it first")
        raise InputError(f"the URDF has no link {flange!r} to fix the tool to; its links: {', '.join(names) or 'none'}")
    parents: dict[str, Element] = {}
    for joint in robot.findall("joint"):
        child = _link_of(joint, "child", names)
        if child in parents:
            raise InputError(f"link {child!r} has two parents, {_name(parents[child])!r} and {_name(joint)!r}")
        _link_of(joint, "parent", names)
        parents[child] = joint
    chain = _chain(parents, flange)
    moving = [i for i, joint in enumerate(chain) if joint.get("type") != "fixed"]
    if not FEWEST <= len(moving) <= MOST:
        raise InputError(
            f"{len(moving)} joints turn between the URDF's root and {flange!r}; {FEWEST} to {MOST} are needed"
        )
    on_chain = {_link_of(joint, "child", names) for joint in chain}
    elements = {_name(link): link for link in robot.findall("link")}
    root = _link_of(chain[0], "parent", names)
    bodies: list[_Body] = [_Body(root)]
    joints: list[Joint] = []
    X_BL = Pose.identity()  # of the URDF's link in the link of the arm, with which it moves
    bodies[0].add(root, X_BL, elements, parents, on_chain)
    for joint in chain:
        X_BL = X_BL @ _origin(joint)
        child = _link_of(joint, "child", names)
        if joint.get("type") != "fixed":
            joints.append(_joint(joint, X_BL))
            bodies[-1].next = X_BL.position
            bodies.append(_Body(child))
            X_BL = Pose.identity()
        if child != flange:
            bodies[-1].add(child, X_BL, elements, parents, on_chain)
    bodies[-1].add_link(elements[flange], X_BL)
    bodies[-1].next = X_BL.position
    links = [body.link(moves=i > 0) for i, body in enumerate(bodies)]
    home = home_of(links, joints, X_BL)
    if home is None:
        raise InputError(
            f"the arm, its base 45 cm behind the board's middle and 5 cm under its top, does not bring {flange!r} over"
            " it with z downwards: it reaches too little, is too low, or z of that link does not point out of it"
        )
    return Arm(robot.get("name") or "arm", tuple(links), tuple(joints), X_BL, home)


class _Body:
    """A link of the arm while it is put together from links of the URDF that are fixed to one another."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.next: Floats = np.zeros(3)
        self._parts: list[tuple[float, Floats, Floats]] = []
        self._capsules: list[Capsule] = []

    def add(
        self, name: str, X_BL: Pose, elements: dict[str, Element], parents: dict[str, Element], on_chain: set[str]
    ) -> None:
        """Add the URDF's link `name`, which stands at X_BL, and all that is fixed to it beside the chain."""
        self.add_link(elements[name], X_BL)
        for child, joint in parents.items():
            if joint.find("parent").get("link") == name and child not in on_chain:  # type: ignore[union-attr]
                if joint.get("type") != "fixed":
                    raise InputError(f"joint {_name(joint)!r} branches off the arm at {name!r}; a chain is needed")
                self.add(child, X_BL @ _origin(joint), elements, parents, on_chain)

    def add_link(self, link: Element, X_BL: Pose) -> None:
        """Add one link of the URDF."""
        inertial = link.find("inertial")
        if inertial is not None:
            self._parts.append(_inertia(inertial, X_BL, _name(link)))
        for collision in link.findall("collision"):
            self._capsules += [
                Capsule(X_BL.apply(capsule.ends), capsule.radius) for capsule in _capsules(collision, _name(link))
            ]

    def link(self, moves: bool) -> ArmLink:
        """The link of the arm."""
        mass = sum(part[0] for part in self._parts)
        centre, inertia = np.zeros(3), np.zeros((3, 3))
        if mass > 0.0:
            centre = np.sum([m * c for m, c, _ in self._parts], axis=0) / mass
            for m, c, about_c in self._parts:
                r = c - centre
                inertia += about_c + m * (r @ r * np.eye(3) - np.outer(r, r))
        if moves and (mass <= 0.0 or np.linalg.eigvalsh(inertia)[0] <= 0.0):
            raise InputError(f"link {self.name!r} moves and has no <inertial> with a mass and moments above zero")
        return ArmLink(self.name, mass, centre, inertia, tuple(self._capsules or [_between(self.next)]))


def _parsed(text: str) -> Element:
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
        at = str(joint.find("parent").get("link"))  # type: ignore[union-attr]
    if not chain:
        raise InputError(f"link {flange!r} is the URDF's root; the last link of an arm is expected")
    return chain[::-1]


def _joint(joint: Element, X_PJ: Pose) -> Joint:
    name = _name(joint)
    axis = _numbers(joint.find("axis"), "xyz", (1.0, 0.0, 0.0), f"the axis of joint {name!r}")
    length = float(np.linalg.norm(axis))
    if length < 1e-6:
        raise InputError(f"the axis of joint {name!r} has length zero")
    limit = joint.find("limit")
    if limit is None:
        raise InputError(
            f"joint {name!r} has no <limit>; velocity, effort and, if it is revolute, its range are needed"
        )
    low, high = -math.inf, math.inf
    if joint.get("type") == "revolute":
        low, high = (_number(limit, bound, f"joint {name!r}") for bound in ("lower", "upper"))
        if not low < high:
            raise InputError(f"joint {name!r} ranges from {low:g} to {high:g}; the upper limit must be the larger")
    velocity, torque = (_number(limit, bound, f"joint {name!r}") for bound in ("velocity", "effort"))
    if velocity <= 0.0 or torque <= 0.0:
        raise InputError(f"joint {name!r} has velocity {velocity:g} and effort {torque:g}; both must be above zero")
    return Joint(name, X_PJ, axis / length, low, high, velocity, torque)


def _inertia(inertial: Element, X_BL: Pose, link: str) -> tuple[float, Floats, Floats]:
    """Mass, centre and inertia about it in the frame B."""
    what = f"the inertia of link {link!r}"
    mass, six = inertial.find("mass"), inertial.find("inertia")
    if mass is None or six is None:
        raise InputError(f"{what} is not complete: <mass> and <inertia> are needed")
    xx, xy, xz, yy, yz, zz = (_number(six, name, what) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    X_BC = X_BL @ _origin(inertial)
    R = X_BC.rotation
    kg = _number(mass, "value", what)
    if kg < 0.0:
        raise InputError(f"{what} has a mass of {kg:g} kg")
    return kg, X_BC.position, R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T


def _capsules(collision: Element, link: str) -> Iterator[Capsule]:
    """Capsules in the frame of the URDF's link that cover a collision primitive; none for a mesh."""
    X = _origin(collision)
    what = f"the collision shape of link {link!r}"
    cylinder, sphere, box = (collision.find(f"geometry/{shape}") for shape in ("cylinder", "sphere", "box"))
    if cylinder is not None:
        half = np.array([0.0, 0.0, _size(cylinder, "length", what) / 2.0])
        yield _around(X.apply(np.array([-half, half])), _size(cylinder, "radius", what))
    elif sphere is not None:
        yield Capsule(np.array([X.position, X.position]), _size(sphere, "radius", what))
    elif box is not None:
        size = _numbers(box, "size", None, what)
        if (size <= 0.0).any():
            raise InputError(f"{what} is a box of {size}; its sides must be above zero")
        thin, wide, long = np.argsort(size, kind="stable")
        count = min(math.ceil(size[wide] / size[thin]), 6)
        strip = size[wide] / count
        for k in range(count):
            ends = np.zeros((2, 3))
            ends[:, long] = [-size[long] / 2.0, size[long] / 2.0]
            ends[:, wide] = (k + 0.5) * strip - size[wide] / 2.0
            yield _around(X.apply(ends), math.hypot(strip, size[thin]) / 2.0)


def _between(next_B: Floats) -> Capsule:
    """The capsule about a link whose shape is not given: from its joint to the next, rounded ends and all."""
    length = float(np.linalg.norm(next_B))
    less = min(RADIUS / length, 0.5) if length > 0.0 else 0.5
    return Capsule(np.outer([less, 1.0 - less], next_B), RADIUS)


def _around(ends: Floats, radius: float) -> Capsule:
    """The capsule that covers a cylinder: a tenth wider, and so it need not reach as far beyond the ends (2, 3)."""
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    less = min(0.45 * radius, length / 2.0)
    return Capsule(ends + np.outer([less, -less], along / length), math.hypot(radius, less))


def _origin(element: Element) -> Pose:
    origin = element.find("origin")
    what = f"the origin in {element.tag} {element.get('name') or ''}".rstrip()
    rpy = _numbers(origin, "rpy", (0.0, 0.0, 0.0), what)
    return Pose(Rotation.from_euler("xyz", rpy).as_matrix(), _numbers(origin, "xyz", (0.0, 0.0, 0.0), what))


def _name(element: Element) -> str:
    name = element.get("name")
    if not name:
        raise InputError(f"a <{element.tag}> of the URDF has no name")
    return name


def _link_of(joint: Element, end: str, names: list[str]) -> str:
    """Name of a joint's parent or child."""
    element = joint.find(end)
    link = None if element is None else element.get("link")
    if link not in names or link is None:
        raise InputError(f"the {end} of joint {_name(joint)!r} is {link!r}, which is no link of the URDF")
    return link


def _numbers(element: Element | None, name: str, default: tuple[float, ...] | None, what: str) -> Floats:
    """(3,) of an attribute."""
    text = None if element is None else element.get(name)
    if text is None and default is not None:
        return np.array(default)
    try:
        three = np.array([float(number) for number in (text or "").split()])
    except ValueError:
        three = np.full(3, math.nan)
    if three.shape != (3,) or not np.isfinite(three).all():
        raise InputError(f"{what} has {name} {text!r}; three numbers are expected")
    return three


def _number(element: Element, name: str, what: str) -> float:
    """A finite number of an attribute."""
    text = element.get(name)
    try:
        number = float(text) if text is not None else math.nan
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{what} has {name} {text!r}; a number is expected")
    return number


def _size(element: Element, name: str, what: str) -> float:
    """A number above zero of an attribute."""
    number = _number(element, name, what)
    if number <= 0.0:
        raise InputError(f"{what} has {name} {number:g}; it must be above zero")
    return number
