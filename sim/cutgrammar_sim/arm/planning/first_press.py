"""One cut that every arm must be able to make, planned before a run begins, so that a wrong flange is found then."""

import numpy as np
import trimesh

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Refused
from cutgrammar_sim.arm.planning.cut_plan import plan_cut
from cutgrammar_sim.arm.planning.rig import Rig

SIZE = (0.04, 0.12, 0.04)
"""Edges of the block in the middle of the board along x, y, z of W [m]."""


def why_no_press(rig: Rig) -> str | None:
    """Why the arm cannot halve a block in the middle of the board, across or along; None if it can."""
    box = trimesh.creation.box(SIZE)
    block = Fragment(Mesh(box.vertices, box.faces), Pose(np.eye(3), np.array([0.0, 0.0, SIZE[2] / 2.0])))
    reason = None
    for normal in ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0)):
        plan = plan_cut((block,), (0,), Plane(np.array(normal), 0.0), rig, rig.arm.home)
        if not isinstance(plan, Refused):
            return None
        reason = plan.reason
    return reason
