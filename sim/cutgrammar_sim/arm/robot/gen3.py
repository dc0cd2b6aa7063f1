"""The Kinova Gen3 with seven joints and the vision module, from the figures of Kinova's own description.

Kinova's description (github.com/Kinovarobotics/ros_kortex, GEN3-7DOF-VISION_ARM_URDF_V12) gives joints, inertias and
limits; its meshes are not needed: capsules cover the links. Angles that it rounds to five digits (3.1416, 1.5708) are
kept rounded, so that both models agree to the last digit.
"""

import math

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.robot.description import Arm, ArmLink, Capsule, Joint

INF = math.inf
HALF, QUARTER = 3.1416, 1.5708
"""Half a turn and a quarter turn, as Kinova rounds them [rad]."""

#         x y z of the origin [m],       roll,     limit,  rad/s,  N m
JOINTS = (
    ((0.0, 0.0, 0.15643), HALF, INF, 1.3963, 39.0),
    ((0.0, 0.005375, -0.12838), QUARTER, 2.24, 1.3963, 39.0),
    ((0.0, -0.21038, -0.006375), -QUARTER, INF, 1.3963, 39.0),
    ((0.0, 0.006375, -0.21038), QUARTER, 2.57, 1.3963, 39.0),
    ((0.0, -0.20843, -0.006375), -QUARTER, INF, 1.2218, 9.0),
    ((0.0, 0.00017505, -0.10593), QUARTER, 2.09, 1.2218, 9.0),
    ((0.0, -0.10593, -0.00017505), -QUARTER, INF, 1.2218, 9.0),
)
FLANGE = ((0.0, 0.0, -0.061525), math.pi)
"""Origin of the flange in the last link [m], and roll about x [rad]."""

#  name, kg, centre of mass [m], inertia about it: xx xy xz yy yz zz [kg m2]
LINKS = (
    ("base", 1.697, (-0.000648, -0.000166, 0.084487), (0.004622, 9e-6, 6e-5, 0.004495, 9e-6, 0.002079)),
    ("shoulder", 1.3773, (-2.3e-5, -0.010364, -0.07336), (0.00457, 1e-6, 2e-6, 0.004831, 0.000448, 0.001409)),
    ("half arm 1", 1.1636, (-4.4e-5, -0.09958, -0.013278), (0.011088, 5e-6, 0.0, 0.001072, -0.000691, 0.011255)),
    ("half arm 2", 1.1636, (-4.4e-5, -0.006641, -0.117892), (0.010932, 0.0, -7e-6, 0.011127, 0.000606, 0.001043)),
    ("forearm", 0.9302, (-1.8e-5, -0.075478, -0.015006), (0.008147, -1e-6, 0.0, 0.000631, -0.0005, 0.008316)),
    ("wrist 1", 0.6781, (1e-6, -0.009432, -0.063883), (0.001596, 0.0, 0.0, 0.001607, 0.000256, 0.000399)),
    ("wrist 2", 0.6781, (1e-6, -0.045483, -0.00965), (0.001641, 0.0, 0.0, 0.00041, -0.000278, 0.001641)),
    ("bracelet", 0.5006, (-0.000281, -0.011402, -0.029798), (0.000587, 3e-6, 3e-6, 0.000369, 0.000118, 0.000609)),
)

#  ends in the link's frame, radius [m]: the smallest capsules around Kinova's collision meshes, plus 1 mm
CAPSULES: tuple[tuple[tuple[tuple[float, float, float], tuple[float, float, float], float], ...], ...] = (
    (((0.0, 0.0, 0.0091), (0.0, 0.0, 0.1401), 0.0562),),
    (((0.0, 0.0, -0.0325), (0.0, -0.0078, -0.1284), 0.0544),),
    (((0.0, 0.0151, -0.0169), (0.0, -0.2134, -0.0048), 0.05),),
    (((0.0, 0.0054, -0.0185), (0.0, -0.0045, -0.2152), 0.053),),
    (((0.0, 0.0034, -0.0201), (0.0, -0.1938, -0.0068), 0.0484),),
    (((0.0, -0.0041, -0.0235), (0.0, -0.0126, -0.1059), 0.0439),),
    (((0.0, 0.0068, -0.0212), (0.0, -0.1005, -0.0002), 0.0402),),
    (
        ((0.0, 0.0, -0.03), (0.0, 0.0, -0.045), 0.045),
        ((-0.0353, -0.0552, -0.0562), (0.0353, -0.0552, -0.0562), 0.0216),  # the vision module
    ),
)
HOME = (0.23, 0.258, 3.159, -1.326, -0.005, -1.558, 0.247)
"""Knife down, its edge 30 cm over the board, at least 4 cm from the lines of sight of the two cameras [rad]."""


def gen3() -> Arm:
    """The arm; its flange is what Kinova calls the end effector's link."""
    return Arm(
        "Kinova Gen3",
        tuple(
            ArmLink(
                name, mass, np.array(centre), _inertia(*six), tuple(Capsule(np.array([a, b]), r) for a, b, r in covers)
            )
            for (name, mass, centre, six), covers in zip(LINKS, CAPSULES, strict=True)
        ),
        tuple(
            Joint(f"joint_{i + 1}", _rolled(origin, roll), np.array([0.0, 0.0, 1.0]), -limit, limit, velocity, torque)
            for i, (origin, roll, limit, velocity, torque) in enumerate(JOINTS)
        ),
        _rolled(*FLANGE),
        np.array(HOME),
    )


def _rolled(origin: tuple[float, float, float], roll: float) -> Pose:
    c, s = math.cos(roll), math.sin(roll)
    return Pose(np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]), np.array(origin))


def _inertia(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float) -> Floats:
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
