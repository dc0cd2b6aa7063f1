"""The fragments among which the arm moves: those on the board, and the one that the gripper carries."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar_sim.arm.planning.paths import Path
from cutgrammar_sim.arm.robot.collision import Body, CollisionChecker, CollisionScene
from cutgrammar_sim.physics.convex_hull import hull_corners

MARGIN = 6e-3
"""Distance that the arm keeps from fragments and board in transit [m]."""
CELL = 4e-3
"""Width of the cells of a footprint [m]."""


@dataclass(frozen=True, eq=False)
class PlanningScene:
    """Fragments on the board with the arm among them.

    Attributes:
        checker: the collision shapes of arm and tool.
        fragments: on the board, without the one that is carried.
        gripper_out: whether the gripper is extended.
        held: the fragment that the gripper carries, if any.
    """

    checker: CollisionChecker
    fragments: Configuration
    gripper_out: bool = False
    held: Body | None = None
    _scenes: dict[tuple[float, bool], CollisionScene] = field(init=False, repr=False, default_factory=dict)

    def is_free(self, q: Floats, margin: float = MARGIN, blade: bool = True) -> bool:
        """Whether nothing touches in any of the postures q (t, n) [rad].

        Args:
            q: the postures.
            margin: distance to keep from fragments and board [m].
            blade: whether the blade keeps it as well.
        """
        if (margin, blade) not in self._scenes:
            bodies = [Body(fragment.mesh, fragment.X_WF) for fragment in self.fragments]
            scene = self.checker.scene(bodies, margin, self.gripper_out, blade, self.held)
            self._scenes[margin, blade] = scene
        return self._scenes[margin, blade].is_free(q)

    def is_path_free(self, path: Path, margin: float = MARGIN, blade: bool = True) -> bool:
        """Whether nothing touches anywhere along `path`; see `is_free`."""
        return self.is_free(path.sampled(), margin, blade)

    def holding(self, held: Body) -> "PlanningScene":
        """The same scene while the gripper carries `held`."""
        return replace(self, gripper_out=True, held=held)

    @cached_property
    def tallest(self) -> float:
        """Height of the highest point of any fragment [m]."""
        return max((float(hull_corners(fragment)[:, 2].max()) for fragment in self.fragments), default=0.0)

    @cached_property
    def footprint(self) -> Floats:
        """(k, 2) centres of the cells that any fragment covers, seen from above, x and y in W [m]."""
        return np.concatenate([np.empty((0, 2)), *(_footprint(fragment) for fragment in self.fragments)])


def _footprint(fragment: Fragment) -> Floats:
    """(k, 2) centres of the cells that touch the outline of the fragment's convex hull, seen from above."""
    outline = hull_corners(fragment)[:, :2]
    lines = ConvexHull(outline).equations
    first, last = np.floor(outline.min(axis=0) / CELL), np.floor(outline.max(axis=0) / CELL)
    x, y = (CELL * (np.arange(low, high + 1) + 0.5) for low, high in zip(first, last, strict=True))
    cells = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    # a cell touches a half plane if its centre is beyond the line by no more than this
    reach = CELL / 2.0 * np.abs(lines[:, :2]).sum(axis=1)
    return np.asarray(cells[(cells @ lines[:, :2].T + lines[:, 2] <= reach).all(axis=1)])
