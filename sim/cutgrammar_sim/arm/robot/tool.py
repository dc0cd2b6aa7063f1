"""The tool on the flange: a knife, and beside it a needle gripper that extends to carry and turn fragments.

Needle grippers hold soft food from above and are driven by air; when retracted, this one does not reach below the
knife. Frames: T is the flange, z out of it. B is the blade: origin in the middle of its edge, y along the edge, z from
the edge to the back, x across the blade. G is the extended gripper: origin between its tips, z back into it. The z axes
of B and G are -z of T.
"""

from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.pose import Pose
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.robot.description import Capsule
from cutgrammar_sim.arm.robot.dynamics import Load

BACK = np.diag([1.0, -1.0, -1.0])
"""Rotation from the axes of B and G to those of T."""

NEEDLES = 0.03
"""Length of the needles, from the end of the gripper's body to their tips [m]."""


@dataclass(frozen=True, eq=False)
class Tool:
    """Knife and gripper.

    Attributes:
        X_TB: the blade in T.
        X_TG: the extended gripper in T.
        length, height, thickness: of the blade, along y, z and x of B [m].
        load: the whole tool as a load on the flange.
        handle: shape of the handle, in T.
        gripper_in, gripper_out: shape of the gripper when retracted and when extended, in T.
    """

    X_TB: Pose
    X_TG: Pose
    length: float
    height: float
    thickness: float
    load: Load
    handle: Capsule
    gripper_in: Capsule
    gripper_out: Capsule


def knife(settings: Settings) -> Tool:
    """The tool that the settings describe."""
    height = settings.kinova.blade_height_mm * 1e-3
    edge = 0.09 + height  # distance from the flange
    aside, tips = 0.07, edge + 0.08
    return Tool(
        X_TB=Pose(BACK, np.array([0.0, 0.0, edge])),
        X_TG=Pose(BACK, np.array([aside, 0.0, tips])),
        length=settings.kinova.blade_length_mm * 1e-3,
        height=height,
        thickness=settings.world.blade_thickness_mm * 1e-3,
        # with the inertia of a slab as large as blade and handle
        load=Load(mass=0.45, p_TC=np.array([0.01, 0.0, 0.09]), inertia=np.diag([2.0e-3, 1.3e-3, 1.1e-3])),
        handle=Capsule(np.array([[0.0, 0.0, 0.02], [0.0, 0.0, 0.09]]), 0.02),
        gripper_in=Capsule(np.array([[aside, 0.0, 0.0], [aside, 0.0, 0.06]]), 0.015),
        gripper_out=Capsule(np.array([[aside, 0.0, 0.0], [aside, 0.0, tips - NEEDLES]]), 0.01),
    )
