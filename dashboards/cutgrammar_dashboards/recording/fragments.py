"""The fragments of a trial in its recording: the current ones, under names that last, and the goal's."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import TreeNode
from cutgrammar.motion import Phase
from cutgrammar_dashboards.recording import blueprint
from cutgrammar_dashboards.recording.arm import thinned
from cutgrammar_dashboards.recording.arm_parts import moving
from cutgrammar_dashboards.recording.fragment_names import followed
from cutgrammar_dashboards.recording.gathered import Gathered
from cutgrammar_dashboards.recording.scene import pose_of, scalars, shape_of, transforms
from cutgrammar_dashboards.recording.writer import Writer
from cutgrammar_dashboards.rendering.palette import PLANE, QUIET, UNTYPED, Colour, graded, nth_colour, tinted
from cutgrammar_dashboards.rendering.placement import aside, quad

ROUNDING = 1e-9
"""Poses whose numbers differ by no more are the same; recordings have single precision."""


class FragmentViews:
    """The views of the current fragments and of the goal's; poses wait until `flush()`, or until the fragment is gone.

    Attributes:
        now: the current fragments, by name.
        perceived: names of the fragments that the planner was given, in its order.
    """

    def __init__(self, writer: Writer, goal: Configuration) -> None:
        self._writer, self._goal = writer, goal
        self.now: dict[int, Fragment] = {}
        self.perceived: list[int] = []
        self._next_name = 0
        self._moved, self._counted = Gathered(writer), Gathered(writer)
        self._colours: dict[str, Colour] = {}
        self._goal_colours = [tinted(UNTYPED, j) for j in range(len(goal))]
        for j, fragment in enumerate(goal):
            path = f"{blueprint.GOAL}/{j}"
            writer.log(path, shape_of(fragment, self._goal_colours[j]), pose_of(fragment))
        self._log_count("goal", len(goal))

    def show(self, configuration: Configuration) -> None:
        """Show the current configuration: add new fragments, update changed poses, remove fragments that are gone."""
        before, self.now = self.now, followed(self.now, configuration, self._next_name)
        for name in before:
            if name not in self.now:
                path = f"{blueprint.NOW}/{name}"
                self._moved.write(path, transforms)  # in the order of logging, poses come before the clear
                self._writer.log(path, rr.Clear(recursive=True))
        for name, fragment in self.now.items():
            if name not in before:
                shape = shape_of(fragment, tinted(UNTYPED, name))
                self._writer.log(f"{blueprint.NOW}/{name}", shape, pose_of(fragment))
            elif _has_moved(before[name].X_WF, fragment.X_WF):
                at = self._writer.moments(np.array([self._writer.seconds]))
                self._moved.add(f"{blueprint.NOW}/{name}", at, fragment.X_WF.to_vector()[None])
        self._next_name = max([self._next_name, *(name + 1 for name in self.now)])
        self.perceived = list(self.now)
        self._log_count("now", len(self.now))
        self._log_count("goal", len(self._goal))

    def show_motion(self, phase: Phase, times: Floats, began: float) -> None:
        """Show how fragments move in one phase, whose samples have these times (k,) since the motion began [s]."""
        assert phase.poses is not None
        kept = thinned(times)
        for i, (name, fragment) in enumerate(self.now.items()):
            changed = kept[moving(phase.poses[kept, i], fragment.X_WF.to_vector())]
            if len(changed):
                moments = self._writer.moments(began + times[changed])
                self._moved.add(f"{blueprint.NOW}/{name}", moments, phase.poses[changed, i])
                self.now[name] = Fragment(fragment.shape, Pose.from_vector(phase.poses[changed[-1], i]))

    def flush(self) -> None:
        """Write the poses and counts that wait."""
        for path in self._moved.paths:
            self._moved.write(path, transforms)
        for path in self._counted.paths:
            self._counted.write(path, scalars)

    def perceive(self, configuration: Configuration) -> None:
        """Note that the planner was given these perceived fragments: each takes the name of the nearest true one."""
        self.perceived = [self.nearest(fragment.p_WC) for fragment in configuration]

    def nearest(self, p_W: Floats) -> int:
        """The name of the current fragment nearest to a point (3,) [m]."""
        return min(self.now, key=lambda name: (float(np.linalg.norm(self.now[name].p_WC - p_W)), name))

    def colour_by_type(self, tree: Sequence[TreeNode]) -> None:
        """Colour the current fragments, and goal fragments by the terminal grounded to them, by their types."""
        for node in tree:
            if node.type is None:
                continue
            if node.goal is not None and node.goal < len(self._goal):
                colour = self._goal_colours[node.goal] = tinted(nth_colour(node.type), node.goal)
                self._recolour(f"{blueprint.GOAL}/{node.goal}", self._goal[node.goal], colour)
            if node.now is not None and node.now < len(self.perceived):
                name = self.perceived[node.now]
                self._recolour_current(name, tinted(nth_colour(node.type), name))

    def show_cut(self, plane: Plane, targets: Sequence[int]) -> None:
        """Show the plane of a planned cut and mark the fragments that it is to divide."""
        corners = quad(plane, [self.now[name] for name in targets])
        self._writer.log(
            f"{blueprint.CUT}/plane",
            rr.Mesh3D(
                vertex_positions=corners,
                triangle_indices=[[0, 1, 2], [0, 2, 3]],
                albedo_factor=(*PLANE, 110),
                face_rendering="DoubleSided",
            ),
        )
        outline = rr.LineStrips3D([np.vstack([corners, corners[:1]])], colors=PLANE, radii=rr.Radius.ui_points(1.5))
        self._writer.log(f"{blueprint.CUT}/outline", outline)
        marks = rr.Points3D(
            [self.now[name].p_WC for name in targets],
            labels=[f"#{name}" for name in targets],
            colors=PLANE,
            radii=rr.Radius.ui_points(3.0),
        )
        self._writer.log(f"{blueprint.CUT}/meant", marks)

    def clear_cut(self) -> None:
        """Remove the planned cut from the views."""
        self._writer.log(blueprint.CUT, rr.Clear(recursive=True))

    def show_pairs(self, pairs: Sequence[tuple[int, int, float]]) -> None:
        """Show the goal beside the result, with lines between matched pairs (reached, goal, IoU), as in Fig. 5.

        A reached fragment takes the colour of the goal fragment that it is matched with.
        """
        names, reached = list(self.now), list(self.now.values())
        if not reached or not pairs:
            return
        partner = {i: j for i, j, _ in pairs}
        for i, name in enumerate(names):
            self._recolour_current(name, self._goal_colours[partner[i]] if i in partner else QUIET)
        beside = aside(reached, self._goal)
        # The view of the goal has its origin here, so only the view of the pairs shows that the goal moves.
        self._writer.log(blueprint.GOAL, rr.Transform3D(translation=beside))
        lines = rr.LineStrips3D(
            [np.stack([reached[i].p_WC, self._goal[j].p_WC + beside]) for i, j, _ in pairs],
            colors=[graded(iou) for *_, iou in pairs],
            labels=[f"{iou:.2f}" for *_, iou in pairs],
            radii=rr.Radius.ui_points(1.0),
        )
        self._writer.log(f"{blueprint.MATCHED}/lines", lines)

    def _recolour_current(self, name: int, colour: Colour) -> None:
        self._recolour(f"{blueprint.NOW}/{name}", self.now[name], colour)

    def _recolour(self, path: str, fragment: Fragment, colour: Colour) -> None:
        """Change the colour of a fragment, unless it is the same."""
        if self._colours.get(path) == colour:
            return
        self._colours[path] = colour
        is_mesh = isinstance(fragment.shape, Mesh)
        fields = rr.Mesh3D.from_fields(albedo_factor=colour) if is_mesh else rr.Points3D.from_fields(colors=colour)
        self._writer.log(path, fields)

    def _log_count(self, name: str, count: int) -> None:
        at = self._writer.moments(np.array([self._writer.seconds]))
        self._counted.add(f"{blueprint.COUNTS}/{name}", at, np.array([[float(count)]]))


def _has_moved(before: Pose, after: Pose) -> bool:
    """Whether two poses differ by more than rounding; most fragments lie still, and matrices are compared fastest."""
    turned, shifted = np.abs(before.rotation - after.rotation).max(), np.abs(before.position - after.position).max()
    return bool(max(turned, shifted) > ROUNDING)
