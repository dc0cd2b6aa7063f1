"""Which strokes of the blade the arm can make: with a posture for every point, and only the blade near anything."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from cutgrammar_sim.arm.planning.paths import Path, find_line, find_posture
from cutgrammar_sim.arm.planning.rig import Rig
from cutgrammar_sim.arm.planning.scene import PlanningScene
from cutgrammar_sim.arm.planning.strokes import Stroke

NEAR = 2e-3
"""Distance that all but the blade keeps from fragments and board during a press [m]; see `strokes` for the blade."""
RUN_UP = 5e-3
"""Distance above the fragment at which the edge begins to reach the speed of the press [m]."""


@dataclass(frozen=True, eq=False)
class Press:
    """A stroke that the arm can make.

    Attributes:
        stroke: of the blade.
        down: path of the joints, from above everything until the edge is on the board.
    """

    stroke: Stroke
    down: Path

    @property
    def begins(self) -> float:
        """Length of the path at which the press at a constant speed begins [m]."""
        return max(0.0, self.down.length - self.stroke.depth - RUN_UP)


def find_presses(rig: Rig, strokes: Iterable[Stroke], scene: PlanningScene) -> Iterator[Press]:
    """Those of `strokes` that the arm can make, in their order.

    Args:
        rig: the arm with its tool.
        strokes: of the blade, in W.
        scene: what lies on the board, the fragments to be cut included.
    """
    for stroke in strokes:
        q = find_posture(rig.arm, stroke.X_WB, rig.tool.X_TB)
        if q is None:
            continue
        up = find_line(rig.arm, stroke.X_WB, rig.tool.X_TB, q, stroke.length * stroke.X_WB.rotation[:, 2])
        if up is not None and scene.is_path_free(up, NEAR, blade=False):
            yield Press(stroke, up.reversed())


def reaches(rig: Rig, stroke: Stroke) -> bool:
    """Whether the arm has a posture for the end of a stroke, whatever it would touch."""
    return find_posture(rig.arm, stroke.X_WB, rig.tool.X_TB) is not None
