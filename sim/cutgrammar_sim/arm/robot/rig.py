"""An arm with its tool and what they may do: what every part of planning needs and no cut changes."""

from dataclasses import dataclass

import numpy as np

from cutgrammar.settings import Settings
from cutgrammar_sim.arm.planning.timing import Burden, Limits, limits_of
from cutgrammar_sim.arm.robot.collision import CollisionChecker
from cutgrammar_sim.arm.robot.description import Arm
from cutgrammar_sim.arm.robot.tool import Tool


@dataclass(frozen=True, eq=False)
class Rig:
    """An arm with its tool.

    Attributes:
        arm, tool: as described.
        checker: their collision shapes.
        limits: of the joints.
        unladen: what the arm bears when it holds the tool alone.
        steepest: greatest angle between vertical and a plane that is pressed [rad].
        press_speed: of the blade's edge [m/s].
        density: of all food [kg/m3].
    """

    arm: Arm
    tool: Tool
    checker: CollisionChecker
    limits: Limits
    unladen: Burden
    steepest: float
    press_speed: float
    density: float


def rig_of(arm: Arm, tool: Tool, settings: Settings) -> Rig:
    """An arm with a tool, as the settings let them be used."""
    return Rig(
        arm=arm,
        tool=tool,
        checker=CollisionChecker(arm, tool),
        limits=limits_of(arm, settings.kinova),
        unladen=Burden((tool.load,)),
        steepest=float(np.radians(settings.kinova.max_tilt_deg)),
        press_speed=settings.kinova.press_speed,
        density=settings.world.density,
    )
