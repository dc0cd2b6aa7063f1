"""An arm with its tool and their limits: the part of a plan's input that is the same for all cuts."""

from dataclasses import dataclass

import numpy as np

from cutgrammar.settings import Settings
from cutgrammar_sim.arm.planning.timing import ExternalLoad, Limits, limits_of
from cutgrammar_sim.arm.robot.collision import CollisionChecker
from cutgrammar_sim.arm.robot.description import Arm
from cutgrammar_sim.arm.robot.tool import Tool


@dataclass(frozen=True, eq=False)
class Rig:
    """An arm with its tool.

    Attributes:
        arm, tool: their descriptions.
        checker: their collision shapes.
        limits: of the joints.
        unladen: load of the tool alone.
        max_tilt: largest angle between the vertical and a plane that is pressed [rad].
        press_speed: speed of the blade's edge during a press [m/s].
        density: of all foods [kg/m3].
    """

    arm: Arm
    tool: Tool
    checker: CollisionChecker
    limits: Limits
    unladen: ExternalLoad
    max_tilt: float
    press_speed: float
    density: float


def rig_of(arm: Arm, tool: Tool, settings: Settings) -> Rig:
    """The rig of an arm and a tool, with the limits that the settings give."""
    return Rig(
        arm=arm,
        tool=tool,
        checker=CollisionChecker(arm, tool),
        limits=limits_of(arm, settings.kinova),
        unladen=ExternalLoad((tool.load,)),
        max_tilt=float(np.radians(settings.kinova.max_tilt_deg)),
        press_speed=settings.kinova.press_speed,
        density=settings.world.density,
    )
