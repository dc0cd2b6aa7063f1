"""The XML of a URDF: the chain of joints from its root to a link, pruned and checked.

What Pinocchio would accept in silence, or refuse without saying where, is an `InputError` in one line that names the
element.
"""

import math
import xml.etree.ElementTree as ElementTree
from collections import Counter
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from cutgrammar.errors import InputError, closest, listed
from cutgrammar.geometry.arrays import Floats
from cutgrammar.untrusted import printable, shortened

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
MAX_ELEMENTS, MAX_DEPTH, MAX_NAME, MAX_LINKS = 20_000, 30, 200, 500
MAX_NUMBER = 1e6
"""Largest magnitude of a number; in metres, radians, kilograms and newtons no arm has more."""
CHUNK = 1 << 16


def parse(text: str) -> Element:
    """The element <robot>; a document type declaration, with which a file can grow without bounds, is refused."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError("the URDF has a document type declaration, which none needs; remove it")
    try:
        _check_size(text)
        robot = ElementTree.fromstring(text)
    except InputError:
        raise
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"the URDF is not XML: {error}") from None
    if robot.tag != "robot":
        raise InputError(f"the URDF's first element is <{shortened(robot.tag)[1:-1]}>; <robot> is expected")
    return robot


def _check_size(text: str) -> None:
    """Refuse more or deeper elements than an arm needs, before a tree is made of them, and words that go on for ever.

    Raises:
        InputError: there are.
        ElementTree.ParseError: the text is not XML.
    """
    parser: Any = ElementTree.XMLPullParser(("start", "end"))
    depth = count = 0
    for first in range(0, len(text), CHUNK):
        parser.feed(text[first : first + CHUNK])
        for event, element in parser.read_events():
            depth += 1 if event == "start" else -1
            count += event == "start"
            if depth > MAX_DEPTH or count > MAX_ELEMENTS:
                raise InputError(
                    f"the URDF has over {MAX_ELEMENTS} elements, or one inside more than {MAX_DEPTH} others; "
                    "that of one arm is expected"
                )
            if event == "start" and len(element.get("name", "")) > MAX_NAME:
                raise InputError(f"a <{element.tag}> of the URDF has a name of more than {MAX_NAME} characters")
            if event == "start" and any(printable(value) != value for value in element.attrib.values()):
                raise InputError(f"a <{element.tag}> of the URDF has control characters, which Pinocchio would print")
            if event == "end":
                element.clear()
    parser.close()


def parents_of(robot: Element, flange: str) -> dict[str, Element]:
    """The joint above each link, by the link's name."""
    names = [name_of(link) for link in robot.findall("link")]
    if len(names) > MAX_LINKS:
        raise InputError(f"the URDF has {len(names)} links; that of one arm, with at most {MAX_LINKS}, is expected")
    for kind, found in (("link", names), ("joint", [name_of(joint) for joint in robot.findall("joint")])):
        if twice := [name for name, number in Counter(found).items() if number > 1]:
            raise InputError(f"the URDF has {found.count(twice[0])} {kind}s called {twice[0]!r}; a name is for one")
    if flange not in names:
        if any("xacro" in element.tag for element in robot):
            raise InputError("the URDF is a xacro file, which is a program that writes one; expand it first")
        known = f"{listed(names) or 'none'}{closest(flange, names)}"
        raise InputError(f"the URDF has no link {flange!r} to fix the tool to; its links: {known}")
    parents: dict[str, Element] = {}
    for joint in robot.findall("joint"):
        for end in ("parent", "child"):
            if link_of(joint, end) not in names:
                link = link_of(joint, end) or None
                raise InputError(f"the {end} of joint {name_of(joint)!r} is {link!r}, which is no link of the URDF")
        child = link_of(joint, "child")
        if child in parents:
            raise InputError(f"link {child!r} has two parents, {name_of(parents[child])!r} and {name_of(joint)!r}")
        parents[child] = joint
    return parents


def chain_to(parents: dict[str, Element], flange: str) -> list[Element]:
    """The joints from the root to the link `flange`."""
    chain: list[Element] = []
    at = flange
    while at in parents:
        joint = parents[at]
        if joint in chain:
            raise InputError(f"the URDF's links go round in a circle at {at!r}")
        if joint.get("type") not in ("revolute", "continuous", "fixed"):
            raise InputError(
                f"joint {name_of(joint)!r} is {joint.get('type')!r}; "
                "only revolute, continuous and fixed ones can be used"
            )
        if joint.find("mimic") is not None:
            raise InputError(f"joint {name_of(joint)!r} mimics another; each joint must have a motor")
        chain.append(joint)
        at = link_of(joint, "parent")
    if not chain:
        raise InputError(f"link {flange!r} is the URDF's root; the last link of an arm is expected")
    return chain[::-1]


def links_fixed_beside(text: str, flange: str) -> list[str]:
    """The other links that move with `flange`, in the order of the URDF."""
    robot = parse(text)
    parents = parents_of(robot, flange)

    def moving(link: str) -> str:
        """The link that `link` is fixed to by way of fixed joints only."""
        while link in parents and parents[link].get("type") == "fixed":
            link = link_of(parents[link], "parent")
        return link

    names = [name_of(link) for link in robot.findall("link")]
    return [name for name in names if name != flange and moving(name) == moving(flange)]


def prune(robot: Element, parents: dict[str, Element], chain: list[Element], flange: str) -> None:
    """Remove all that the arm does not need: what is beyond the flange, what only looks like something, and meshes."""
    on_chain = {link_of(chain[0], "parent"), *(link_of(joint, "child") for joint in chain)}
    kept = set(on_chain)
    grown = True
    while grown:
        grown = False
        for child, joint in parents.items():
            parent = link_of(joint, "parent")
            if child in kept or parent == flange or parent not in kept:
                continue
            if joint.get("type") != "fixed":
                raise InputError(f"joint {name_of(joint)!r} branches off the arm at {parent!r}; a chain is needed")
            kept.add(child)
            grown = True
    for element in list(robot):
        name = {"link": element.get("name"), "joint": link_of(element, "child")}.get(element.tag)
        if name not in kept:
            robot.remove(element)
    for link in robot.findall("link"):
        for part in [*link.findall("visual"), *link.findall("collision")]:
            if part.tag == "visual" or part.find("geometry/mesh") is not None:
                link.remove(part)


def check_numbers(robot: Element) -> None:
    """Refuse attributes that are missing, not numbers, or not above zero where they must be."""
    for owner in robot:
        for element in owner.iter():
            subject = f"<{element.tag}> of {owner.tag} {owner.get('name')!r}"
            if element.tag == "inertial" and (element.find("mass") is None or element.find("inertia") is None):
                raise InputError(f"{subject} is not complete: <mass> and <inertia> are needed")
            for name, count in NUMBERS.get(element.tag, {}).items():
                if element.get(name) is None and element.tag in ("origin", "axis"):
                    continue
                values = numbers_of(element, name, count, subject)
                if element.tag in ("cylinder", "sphere", "box") and (values <= 0.0).any():
                    raise InputError(f"{subject} has {name} {element.get(name)!r}; it must be above zero")
                if element.tag == "mass" and values[0] < 0.0:
                    raise InputError(f"{subject} is {values[0]:g} kg")


def name_of(element: Element) -> str:
    """An element's name.

    Raises:
        InputError: it has none.
    """
    name = element.get("name")
    if not name:
        raise InputError(f"a <{element.tag}> of the URDF has no name")
    return name


def link_of(joint: Element, end: str) -> str:
    """Name of a joint's parent or child, empty where it has none."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def numbers_of(element: Element, name: str, count: int, subject: str) -> Floats:
    """(count,) finite numbers of an attribute."""
    text = element.get(name)
    try:
        numbers = np.array([float(number) for number in (text or "").split()])
    except ValueError:
        numbers = np.full(count, math.nan)
    if numbers.shape != (count,) or "_" in (text or "") or not (np.abs(numbers) <= MAX_NUMBER).all():
        raise InputError(
            f"{subject} has {name} {shortened(text)}; {'three numbers are' if count == 3 else 'a number is'} expected"
        )
    return numbers
