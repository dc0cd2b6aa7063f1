"""One cut that every arm must be able to make, planned before a run begins, so that a wrong flange is found then."""

import numpy as np

from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Refused
from cutgrammar_sim.arm.planning.cut_plan import plan_cut
from cutgrammar_sim.arm.planning.rig import Rig
from cutgrammar_sim.foods import carrot


def why_no_press(rig: Rig) -> str | None:
    """Why the arm cannot halve a carrot in the middle of the board, across or along; None if it can."""
    mesh = carrot(np.random.default_rng(0))
    position = np.array([0.0, 0.0, -mesh.vertices[:, 2].min()])
    lying = Fragment(mesh, Pose(np.eye(3), position))
    reason = None
    for normal in np.eye(3)[:2]:
        plan = plan_cut((lying,), (0,), Plane.through(lying.p_WC, normal), rig, rig.arm.home)
        if not isinstance(plan, Refused):
            return None
        reason = plan.reason
    return reason
