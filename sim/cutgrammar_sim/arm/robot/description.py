"""An arm as plain data: a chain of links from a fixed base to a flange, with the figures that its maker gives.

Frames: A is the arm's base, P and L are the links before and after a joint, J is the joint's frame at angle 0, T is the
flange, whose z points out of it. The frame of link L is J turned by the joint's angle about its axis.
"""

from dataclasses import dataclass, field

import numpy as np

from cutgrammar.geometry.arrays import Floats, frozen_floats
from cutgrammar.geometry.pose import Pose

X_WA = Pose(np.eye(3), np.array([-0.45, 0.0, -0.05]))
"""Pose of the base: 45 cm behind the middle of the board and 5 cm under its top, which is z = 0 of W."""


@dataclass(frozen=True, eq=False)
class Capsule:
    """All points within `radius` of a segment.

    Attributes:
        ends: (2, 3) ends of the segment, in the frame of the link or tool that it covers [m].
        radius: [m].
    """

    ends: Floats
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "ends", frozen_floats(self.ends, (2, 3), "ends"))


@dataclass(frozen=True, eq=False)
class ArmLink:
    """A link's inertia and collision shape.

    Attributes:
        name: of the link.
        mass: [kg].
        p_LC: (3,) centre of mass in L [m].
        inertia: (3, 3) about the centre of mass, axes of L [kg m2].
        capsules: capsules that cover the link, in L; none for a link that cannot collide.
    """

    name: str
    mass: float
    p_LC: Floats
    inertia: Floats
    capsules: tuple[Capsule, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "p_LC", frozen_floats(self.p_LC, (3,), "p_LC"))
        object.__setattr__(self, "inertia", frozen_floats(self.inertia, (3, 3), "inertia"))


@dataclass(frozen=True, eq=False)
class Joint:
    """A revolute joint between one link and the next.

    Attributes:
        name: of the joint.
        X_PJ: its frame at angle 0 in the link before it.
        axis: (3,) unit axis in J.
        low, high: range of the angle, -inf and inf for a joint without limits [rad].
        velocity: maximum velocity [rad/s].
        torque: maximum torque of the motor [N m].
    """

    name: str
    X_PJ: Pose
    axis: Floats
    low: float
    high: float
    velocity: float
    torque: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "axis", frozen_floats(self.axis, (3,), "axis"))


@dataclass(frozen=True, eq=False)
class Arm:
    """A serial arm.

    Attributes:
        name: of the arm.
        links: n + 1 links, the fixed base first.
        joints: n joints; joint i is between links i and i + 1.
        X_LT: the flange in the last link.
        home: (n,) posture out of the cameras' sight with the tool above the board [rad].
        position_limits: (n, 2) lowest and highest angle of each joint, -inf and inf where it has none [rad].
        velocity_limits, torque_limits: (n,) maximum of each joint [rad/s, N m].
    """

    name: str
    links: tuple[ArmLink, ...]
    joints: tuple[Joint, ...]
    X_LT: Pose
    home: Floats
    position_limits: Floats = field(init=False, repr=False)
    velocity_limits: Floats = field(init=False, repr=False)
    torque_limits: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if len(self.links) != len(self.joints) + 1:
            raise ValueError(f"{len(self.links)} links and {len(self.joints)} joints are no chain from base to flange")
        object.__setattr__(self, "home", frozen_floats(self.home, (len(self.joints),), "home"))
        limits = np.array([[joint.low, joint.high, joint.velocity, joint.torque] for joint in self.joints])
        limits.setflags(write=False)
        object.__setattr__(self, "position_limits", limits[:, :2])
        object.__setattr__(self, "velocity_limits", limits[:, 2])
        object.__setattr__(self, "torque_limits", limits[:, 3])
