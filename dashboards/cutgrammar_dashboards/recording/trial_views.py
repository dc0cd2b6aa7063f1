"""The views of one trial: an observer of its events that shows them by a writer."""

import numpy as np
import rerun as rr

from cutgrammar.events import CutFailed, CutMade, CutRefused, Event, GaveUp, Planned, Scored
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.interfaces import Sighted
from cutgrammar.motion import Motion
from cutgrammar_dashboards.recording import blueprint
from cutgrammar_dashboards.recording.arm import ArmViews, summary
from cutgrammar_dashboards.recording.fragments import FragmentViews
from cutgrammar_dashboards.recording.gathered import Gathered
from cutgrammar_dashboards.recording.scene import markdown, scalars
from cutgrammar_dashboards.recording.search import show_search, show_tree
from cutgrammar_dashboards.recording.writer import HOLD_TICKS, Writer
from cutgrammar_dashboards.rendering.explanation_text import score_text
from cutgrammar_dashboards.rendering.palette import QUIET, UNSEGMENTED, nth_colour
from cutgrammar_dashboards.rendering.placement import corners_W

MAX_SEEN_POINTS = 4000
"""Maximum number of points that are recorded of one sight of the cameras."""


class TrialViews:
    """An observer that shows a trial by a writer.

    Args:
        writer: to the file or the viewer.
        title: e.g. "N1M1, trial 12, in-place, grammar, run 0".
        start: the initial configuration, in the world frame.
        goal: the goal's fragments.
        arm: the views of the arm in an earlier trial that the writer showed.

    Attributes:
        has_cameras: whether cameras saw the fragments.
        arm: the views of the arm; None while no robot has made a cut.
        workplace: (2, 3) lowest and highest corner of the box around the initial fragments, in W [m].
    """

    def __init__(
        self, writer: Writer, title: str, start: Configuration, goal: Configuration, arm: ArmViews | None = None
    ) -> None:
        self._writer, self._title = writer, title
        self._n_refusals = 0
        self.has_cameras = False
        self.arm = arm
        self.workplace = workplace_of(start)
        writer.log("", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        blueprint.series_styles(writer)
        self._searched = Gathered(writer)
        self._fragments = FragmentViews(writer, goal)
        self._fragments.show(start)
        self._say("INFO", f"{title}: {len(start)} to be cut into {len(goal)} fragments")
        begin = f"**{title}**\n\n{len(start)} objects, {len(goal)} fragments wanted."
        writer.log(blueprint.OUTCOME, markdown(begin))

    def flush(self) -> None:
        """Write what waits for more of its kind."""
        self._fragments.flush()
        self._searched.write(blueprint.SEARCH, scalars)
        if self.arm is not None:
            self.arm.flush()

    def __call__(self, event: Event) -> None:
        """Show one event of the trial."""
        match event:
            case Planned():
                self._planned(event)
            case Sighted():
                self._sighted(event)
            case CutMade():
                self._made(event)
            case CutRefused():
                self._n_refusals += 1
                self._writer.tick(HOLD_TICKS)
                self._fragments.clear_cut()
                self._show_phase(f"cut {event.step} refused: {event.reason}")
                self._say("WARN", f"cut {event.step} refused (attempt {event.attempt + 1}): {event.reason}")
            case CutFailed():
                self._writer.tick(HOLD_TICKS)
                self._say("ERROR", f"cut {event.step} failed: {event.reason}")
            case GaveUp():
                self._writer.tick()
                self._say("ERROR", f"gave up at cut {event.step}: {event.reason}")
            case Scored():
                self._scored(event)

    def _say(self, level: str, text: str) -> None:
        """Add a line to the text log."""
        self._writer.log(blueprint.LOG, rr.TextLog(text, level=level))

    def _planned(self, event: Planned) -> None:
        why = event.cut.explanation
        self._writer.tick()
        text = "planned"
        targets = list(dict.fromkeys(map(self._fragments.nearest, event.cut.p_WC))) or list(self._fragments.now)
        if why is not None:
            show_search(self._writer, self._searched, why)
            cut = {i for i, name in enumerate(self._fragments.perceived) if name in targets}
            show_tree(self._writer, why, self._perceived_name, cut)
            self._fragments.colour_by_type(why.tree)
            text = f"{why.production}; {score_text(why)}; {why.rollouts} rollouts, {why.dead_ends} dead ends" + (
                ", the best tree is a dead end itself" if why.dead_end else ""
            )
        self._fragments.show_cut(event.cut.plane_W, targets)
        names = ", ".join(f"#{name}" for name in targets)
        heading = f"cut {event.step}, attempt {event.attempt + 1}, of {names}"
        self._say("INFO", f"{heading}: {text} ({event.seconds:.2f} s)")
        self._show_phase(f"cut {event.step} is planned, of {names}")

    def _perceived_name(self, index: int) -> str | None:
        perceived = self._fragments.perceived
        return f"#{perceived[index]}" if index < len(perceived) else None

    def _sighted(self, event: Sighted) -> None:
        self.has_cameras = True
        self._writer.tick()
        count = min(len(event.points), MAX_SEEN_POINTS)
        kept = np.arange(count) * len(event.points) // max(count, 1)
        points, labels = event.points[kept], event.labels[kept]
        colours = [QUIET if label < 0 else nth_colour(label) for label in labels.tolist()]
        size = rr.Radius.ui_points(1.5)
        self._writer.log(blueprint.SEEN, rr.Points3D(points, colors=UNSEGMENTED, radii=size))
        self._writer.log(blueprint.SEGMENTED, rr.Points3D(points, colors=colours, radii=size))
        self._fragments.perceive(event.configuration)
        left_out = (event.labels < 0).mean() if len(event.labels) else 0.0
        self._say(
            "INFO",
            f"before cut {event.step} the cameras saw {len(event.points)} points and {len(event.configuration)} "
            f"fragments in them, of {len(self._fragments.now)} in the scene; "
            f"{100 * left_out:.1f} % of the points were left out",
        )

    def _made(self, event: CutMade) -> None:
        self._writer.tick(HOLD_TICKS)
        if event.motion is not None:
            self._show_motion(event.step, event.motion)
        self._writer.move_to(step=event.step)
        self._fragments.clear_cut()
        self._fragments.show(event.configuration)
        n_fragments = len(self._fragments.now)
        self._say("INFO", f"cut {event.step} made: {event.products} products, {n_fragments} fragments now")
        if event.execution is not None:
            text = summary(event.execution)
            self._say("INFO" if event.execution.limits_kept else "WARN", f"the arm: {text}")
            self._show_phase(f"cut {event.step} is made: {text}")

    def _show_motion(self, step: int, motion: Motion) -> None:
        """Show a motion from its first to its last sample."""
        self.arm = self.arm or ArmViews(self._writer, motion)
        began = self._writer.seconds
        self.arm.show(motion, began)
        ends = [*(phase.first for phase in motion.phases[1:]), len(motion.times)]
        for phase, end in zip(motion.phases, ends, strict=True):
            self._writer.move_to(seconds=began + float(motion.times[phase.first]))
            is_cut = len(phase.fragments) != len(self._fragments.now)
            if phase.poses is not None or is_cut:
                self._fragments.clear_cut()
            if is_cut:
                self._writer.move_to(step=step)
            self._fragments.show(phase.fragments)
            self._show_phase(f"cut {step}: **{phase.name}**")
            if phase.poses is not None:
                self._fragments.show_motion(phase, motion.times[phase.first : end], began)
        self._writer.move_to(seconds=began + float(motion.times[-1]))

    def _show_phase(self, text: str) -> None:
        """Write what the arm does into the view beside it."""
        if self.arm is not None:
            self._writer.log(blueprint.PHASE, markdown(text))

    def _scored(self, event: Scored) -> None:
        self._fragments.clear_cut()
        self._writer.tick()
        why = f" ({event.reason})" if event.reason else ""
        matched = event.scores.get("iou")
        iou = f"unknown{why}" if matched is None else f"{matched:.3f}"
        scores = f"strict IoU {event.iou_strict:.3f}, matched IoU {iou}"
        self._say("INFO", f"scored: {scores}, {len(event.pairs)} pairs")
        self._writer.log("score/iou/strict", rr.Scalars(event.iou_strict))
        if matched is not None:
            self._writer.log("score/iou/matched", rr.Scalars(matched))
        self._writer.log(blueprint.OUTCOME, markdown(self._outcome(event, iou)))
        if event.fragments == len(self._fragments.now):  # otherwise the scored configuration was never observed
            self._fragments.show_pairs(event.pairs)

    def _outcome(self, event: Scored, iou: str) -> str:
        names = {i: f"#{name}" for i, name in enumerate(self._fragments.now)}
        worst_first = sorted(event.pairs, key=lambda pair: pair[2])
        lines = [
            f"**{self._title}**",
            "",
            f"strict IoU **{event.iou_strict:.3f}**, matched IoU **{iou}**; {event.fragments} fragments of "
            f"{event.goal_fragments} wanted; {self._writer.step} cuts, {self._n_refusals} refusals",
            "",
            "| reached | matched with | IoU |",
            "|---|---|---|",
            *(f"| {names.get(i, '?')} | goal {j} | {share:.3f} |" for i, j, share in worst_first),
        ]
        return "\n".join(lines)


def workplace_of(start: Configuration) -> Floats:
    """(2, 3) lowest and highest corner of the box around the initial fragments [m]; of a point if there are none."""
    if not start:
        return np.zeros((2, 3))
    corners = corners_W(start)
    return np.stack([corners.min(axis=0), corners.max(axis=0)])
