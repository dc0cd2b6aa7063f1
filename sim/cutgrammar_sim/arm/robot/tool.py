"""The tool on the flange: a knife, and beside it a needle gripper that comes out to carry and turn fragments.

Needle grippers hold soft food from above, driven by air; drawn in, this one stays clear of the knife's work. Frames:
T is the flange, z out of it. B is the blade: origin in the middle of its edge, y along the edge, z from the edge to the
back, x across the blade. G is the gripper come out: origin between its tips, z back into it. Both look back at the
flange: their z is -z of T.
"""

from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.pose import Pose
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.robot.description import Capsule
from cutgrammar_sim.arm.robot.dynamics import Load

BACK = np.diag([1.0, -1.0, -1.0])
"""Turns T into the axes of B and G."""

NEEDLES = 0.03
"""From where the gripper's body ends to the tips of its needles [m]."""


@dataclass(frozen=True, eq=False)
class Tool:
    """Knife and gripper.

    Attributes:
        X_TB: the blade in T.
        X_TG: the gripper in T, come out.
        length, height, thickness: of the blade, along y, z and x of B [m].
        mass: of the whole [kg].
        p_TC: its centre of mass in T [m].
        inertia: (3, 3) about the centre of mass, axes of T [kg m2].
        handle: what holds the blade, in T.
        gripper_in, gripper_out: the gripper drawn in and come out, in T.
    """

    X_TB: Pose
    X_TG: Pose
    length: float
    height: float
    thickness: float
    mass: float
    p_TC: Floats
    inertia: Floats
    handle: Capsule
    gripper_in: Capsule
    gripper_out: Capsule

    @property
    def load(self) -> Load:
        """What the flange bears of it."""
        return Load(self.mass, self.p_TC, self.inertia)


def knife(settings: Settings) -> Tool:
    """The tool that the settings describe."""
    height = settings.kinova.blade_height_mm * 1e-3
    edge = 0.09 + height  # from the flange
    aside, tips = 0.07, edge + 0.08
    return Tool(
        X_TB=Pose(BACK, np.array([0.0, 0.0, edge])),
        X_TG=Pose(BACK, np.array([aside, 0.0, tips])),
        length=settings.kinova.blade_length_mm * 1e-3,
        height=height,
        thickness=settings.world.blade_thickness_mm * 1e-3,
        mass=0.45,
        p_TC=np.array([0.01, 0.0, 0.09]),
        inertia=np.diag([2.0e-3, 1.3e-3, 1.1e-3]),  # as of a slab as large as blade and handle
        handle=Capsule(np.array([[0.0, 0.0, 0.02], [0.0, 0.0, 0.09]]), 0.02),
        gripper_in=Capsule(np.array([[aside, 0.0, 0.0], [aside, 0.0, 0.06]]), 0.015),
        gripper_out=Capsule(np.array([[aside, 0.0, 0.0], [aside, 0.0, tips - NEEDLES]]), 0.01),
    )
