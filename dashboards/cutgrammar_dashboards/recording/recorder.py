"""One trial as a rerun file: an observer of its events, with no viewer, no network and no telemetry.

Three timelines: `step`, the number of cuts made; `round`, which moves with every round of search and every event, so
that refused cuts and the search itself can be played back; and `time`, the simulated seconds of all motions, where what
is not a motion stands for a second, so that it plays as a film. The file is written beside its place and renamed by
`close`; a file that bears its final name is whole.
"""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from cutgrammar.atomic_files import put_in_place
from cutgrammar.events import CutFailed, CutMade, CutRefused, Event, GaveUp, Planned, Scored
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Explanation, Sighted, TreeNode
from cutgrammar.motion import Motion, Phase
from cutgrammar_dashboards.figures.layout import tree_layout
from cutgrammar_dashboards.recording import blueprint
from cutgrammar_dashboards.recording.arm_recording import ArmRecording, moving, thinned, told
from cutgrammar_dashboards.recording.fragment_names import followed, shape_digest
from cutgrammar_dashboards.recording.scene import aside, markdown, points_of, pose_of, quad, shape_of
from cutgrammar_dashboards.rendering.palette import (
    PLANE,
    QUIET,
    UNSEGMENTED,
    UNTYPED,
    Colour,
    graded,
    nth_colour,
    tinted,
)

APPLICATION = "cutgrammar"
HELD = 8
"""Ticks of `round` for which a planned cut stands before its outcome, so that one sees it when the file is played."""
PAUSE = 1.0
"""What an event that is no motion takes of `time` [s]."""
SIGHT = 4000
"""Most points kept of what cameras saw."""


class Recorder:
    """Writes what happens in one trial to one file; `path` is where it stands once closed."""

    def __init__(self, path: Path, title: str, start: Configuration, goal: Configuration) -> None:
        self.path = path
        self._partial = path.with_name(path.name + ".partial")
        path.parent.mkdir(parents=True, exist_ok=True)
        # Rows wait for one another, so that few, large chunks are written: a chunk by itself takes some 2 kB.
        waiting = rr.ChunkBatcherConfig(flush_tick=600.0)
        self._out: Any = rr.RecordingStream(
            APPLICATION, recording_id=_recording_id(title, start, goal), batcher_config=waiting
        )
        self._out.send_recording_name(title)
        self._title, self._goal = title, goal
        self._colours: dict[str, Colour] = {}
        self._goal_colours = [tinted(UNTYPED, j) for j in range(len(goal))]
        self._now: dict[int, Fragment] = {}
        self._next, self._step, self._round, self._seconds = 0, 0, 0, 0.0
        self._arm: ArmRecording | None = None
        self._sighted = False
        self._met: list[int] = []  # the name of each fragment that the planner was given
        self._refusals = 0
        self._at()
        self._log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        blueprint.series_styles(self._out)
        self._show_goal()
        self._show_now(start)
        self._say("INFO", f"{title}: {len(start)} to be cut into {len(goal)} fragments")
        self._log(blueprint.OUTCOME, markdown(f"**{title}**\n\n{len(start)} objects, {len(goal)} fragments wanted."))

    def __call__(self, event: Event) -> None:
        """Record one event of the trial."""
        match event:
            case Planned():
                self._planned(event)
            case Sighted():
                self._saw(event)
            case CutMade():
                self._made(event)
            case CutRefused():
                self._refusals += 1
                self._tick(HELD)
                self._clear_cut()
                self._does(f"cut {event.step} refused: {event.reason}")
                self._say("WARN", f"cut {event.step} refused (attempt {event.attempt + 1}): {event.reason}")
            case CutFailed():
                self._tick(HELD)
                self._say("ERROR", f"cut {event.step} failed: {event.reason}")
            case GaveUp():
                self._tick()
                self._say("ERROR", f"gave up at cut {event.step}: {event.reason}")
            case Scored():
                self._scored(event)

    def close(self) -> None:
        """Finish the file and give it its name."""
        # Only now is it known what the recording holds; until here rerun kept it in memory.
        self._out.save(self._partial, default_blueprint=blueprint.trial_blueprint(self._arm is not None, self._sighted))
        self._out.flush()
        self._out.disconnect()
        put_in_place(self._partial, self.path)

    # --- events -------------------------------------------------------------------------------------------------------

    def _planned(self, event: Planned) -> None:
        why = event.cut.explanation
        self._tick()
        if why is None:
            said = "planned"
        else:
            self._show_search(why)
            self._show_tree(why.tree)
            self._take_types(why.tree)
            said = (
                f"{why.production}; log posterior {why.log_posterior:.2f} = prior {why.log_prior:.2f} + shape "
                f"{why.log_shape:.2f} + layout {why.log_layout:.2f}; {why.rollouts} rollouts, {why.dead_ends} dead ends"
                + (", the best tree is a dead end itself" if why.dead_end else "")
            )
        meant = list(dict.fromkeys(self._nearest(p) for p in event.cut.p_WC)) or list(self._now)
        self._show_cut(event.cut.plane_W, meant)
        named = ", ".join(f"#{name}" for name in meant)
        self._say("INFO", f"cut {event.step}, attempt {event.attempt + 1}, of {named}: {said} ({event.seconds:.2f} s)")
        self._does(f"cut {event.step} is planned, of {named}")

    def _saw(self, event: Sighted) -> None:
        self._sighted = True
        self._tick()
        count = min(len(event.points), SIGHT)
        kept = np.arange(count) * len(event.points) // max(count, 1)
        points, labels = event.points[kept], event.labels[kept]
        colours = [QUIET if label < 0 else nth_colour(label) for label in labels.tolist()]
        self._log(blueprint.SEEN, rr.Points3D(points, colors=UNSEGMENTED, radii=rr.Radius.ui_points(1.5)))
        self._log(blueprint.SEGMENTED, rr.Points3D(points, colors=colours, radii=rr.Radius.ui_points(1.5)))
        self._met = [self._nearest(fragment.p_WC) for fragment in event.configuration]
        lost = (event.labels < 0).mean() if len(event.labels) else 0.0
        self._say(
            "INFO",
            f"before cut {event.step} the cameras saw {len(event.points)} points and {len(event.configuration)} "
            f"fragments in them, where there are {len(self._now)}; {100 * lost:.1f} % of the points were left out",
        )

    def _made(self, event: CutMade) -> None:
        self._tick(HELD)
        if event.motion is not None:
            self._moved(event.step, event.motion)
        self._step = event.step
        self._at()
        self._clear_cut()
        self._show_now(event.configuration)
        self._say("INFO", f"cut {event.step} made: {event.products} products, {len(self._now)} fragments now")
        if event.execution is not None:
            self._say("INFO" if event.execution.limits_kept else "WARN", f"the arm: {told(event.execution)}")
            self._does(f"cut {event.step} is made: {told(event.execution)}")

    def _moved(self, step: int, motion: Motion) -> None:
        """Record a motion from its first to its last sample."""
        self._arm = self._arm or ArmRecording(self._out)
        began = self._seconds

        def clock(seconds: Floats) -> list[Any]:
            return [
                rr.TimeColumn("time", duration=began + seconds),
                rr.TimeColumn("step", sequence=[self._step] * len(seconds)),
                rr.TimeColumn("round", sequence=[self._round] * len(seconds)),
            ]

        self._arm.show(motion, clock)
        ends = [*(phase.first for phase in motion.phases[1:]), len(motion.times)]
        for phase, end in zip(motion.phases, ends, strict=True):
            self._seconds = began + float(motion.times[phase.first])
            self._at()
            before = set(self._now)
            if phase.poses is not None or len(phase.fragments) != len(before):
                self._clear_cut()
            if len(phase.fragments) != len(before):
                self._step = step
                self._at()
            self._show_now(phase.fragments)
            self._does(f"cut {step}: **{phase.name}**")
            if phase.poses is not None:
                self._carried(phase, motion.times[phase.first : end], clock)
        self._seconds = began + float(motion.times[-1])
        self._at()

    def _carried(self, phase: Phase, times: Floats, clock: Any) -> None:
        """Record how fragments move in one phase."""
        assert phase.poses is not None
        kept = thinned(times)
        for i, (name, fragment) in enumerate(list(self._now.items())):
            seven = phase.poses[kept, i]
            moved = moving(seven, fragment.X_WF.to_vector())
            if not len(moved):
                continue
            poses = [Pose.from_vector(numbers) for numbers in seven[moved]]
            columns = rr.Transform3D.columns(
                translation=[X.position for X in poses], mat3x3=[X.rotation for X in poses]
            )
            for root in (blueprint.NOW, blueprint.CLOUDS):
                self._out.send_columns(f"{root}/{name}", indexes=clock(times[kept][moved]), columns=columns)
            self._now[name] = Fragment(fragment.shape, poses[-1])

    def _does(self, text: str) -> None:
        if self._arm is not None:
            self._log(blueprint.PHASE, markdown(text))

    def _scored(self, event: Scored) -> None:
        self._clear_cut()
        self._tick()
        why = f" ({event.reason})" if event.reason else ""
        known = f"unknown{why}" if event.iou is None else f"{event.iou:.3f}"
        self._say("INFO", f"scored: strict IoU {event.iou_strict:.3f}, matched IoU {known}, {len(event.pairs)} pairs")
        self._log("score/iou/strict", rr.Scalars(event.iou_strict))
        if event.iou is not None:
            self._log("score/iou/matched", rr.Scalars(event.iou))
        self._log(blueprint.OUTCOME, markdown(self._outcome(event, known)))
        if event.fragments == len(self._now):  # else what was scored is not what was last seen
            self._show_pairs(event.pairs)

    def _outcome(self, event: Scored, known: str) -> str:
        names = {i: f"#{name}" for i, name in enumerate(self._now)}
        rows = [
            f"| {names.get(i, '?')} | goal {j} | {iou:.3f} |" for i, j, iou in sorted(event.pairs, key=lambda p: p[2])
        ]
        return "\n".join(
            [
                f"**{self._title}**",
                "",
                f"strict IoU **{event.iou_strict:.3f}**, matched IoU **{known}**; {event.fragments} fragments of "
                f"{event.goal_fragments} wanted; {self._step} cuts, {self._refusals} refusals",
                "",
                "| reached | matched with | IoU |",
                "|---|---|---|",
                *rows,
            ]
        )

    # --- what is shown ------------------------------------------------------------------------------------------------

    def _show_goal(self) -> None:
        for j, fragment in enumerate(self._goal):
            path = f"{blueprint.GOAL}/{j}"
            self._log(path, *shape_of(fragment, self._goal_colours[j]))
            self._log(path, pose_of(fragment))
        self._log(f"{blueprint.COUNTS}/goal", rr.Scalars(float(len(self._goal))))

    def _show_now(self, configuration: Configuration) -> None:
        before, self._now = self._now, followed(self._now, configuration, self._next)
        for name in before:
            if name not in self._now:
                for root in (blueprint.NOW, blueprint.CLOUDS):
                    self._log(f"{root}/{name}", rr.Clear(recursive=True))
        for name, fragment in self._now.items():
            if name >= self._next:
                colour = tinted(UNTYPED, name)
                self._log(f"{blueprint.NOW}/{name}", *shape_of(fragment, colour))
                self._log(f"{blueprint.CLOUDS}/{name}", points_of(fragment, colour))
            if name not in before or not np.array_equal(fragment.X_WF.to_vector(), before[name].X_WF.to_vector()):
                for root in (blueprint.NOW, blueprint.CLOUDS):
                    self._log(f"{root}/{name}", pose_of(fragment))
        self._next = max([self._next, *(name + 1 for name in self._now)])
        self._met = list(self._now)
        for path, count in (("now", len(self._now)), ("goal", len(self._goal))):
            self._log(f"{blueprint.COUNTS}/{path}", rr.Scalars(float(count)))

    def _show_search(self, why: Explanation) -> None:
        history = np.asarray(why.history, dtype=np.float64)
        if not len(history):
            return
        known = np.isfinite(history)
        rounds = self._round + np.arange(len(history))
        if known.any():
            self._out.send_columns(
                blueprint.SEARCH,
                indexes=[
                    rr.TimeColumn("round", sequence=rounds[known]),
                    rr.TimeColumn("time", duration=self._seconds + PAUSE * (rounds[known] - rounds[-1]) / len(rounds)),
                ],
                columns=rr.Scalars.columns(scalars=history[known]),
            )
        self._round += len(history) - 1
        self._at()

    def _show_tree(self, tree: Sequence[TreeNode]) -> None:
        place = tree_layout.positions(tree)
        ids = [str(i) for i in range(len(tree))]
        labels = [self._label(node) for node in tree]
        colours = [QUIET if node.type is None else nth_colour(node.type) for node in tree]
        edges = [(str(node.parent), str(i)) for i, node in enumerate(tree) if node.parent is not None]
        lowest = place[:, 1].max(initial=0.0) + 90.0
        for i, node in enumerate(tree):
            if node.goal is not None:
                ids.append(f"goal {node.goal}")
                labels.append(f"g{node.goal}")
                colours.append(colours[i])
                edges.append((str(i), f"goal {node.goal}"))
                place = np.vstack([place, [place[i, 0], lowest]])
        self._log(
            blueprint.TREE,
            rr.GraphNodes(ids, positions=place, labels=labels, colors=colours, show_labels=True),
            rr.GraphEdges(edges, graph_type="directed"),
        )

    def _label(self, node: TreeNode) -> str:
        if node.type is None:
            return "S"
        known = node.now is not None and node.now < len(self._met)
        return f"#{self._met[node.now]}: c{node.type}" if known and node.now is not None else f"c{node.type}"

    def _take_types(self, tree: Sequence[TreeNode]) -> None:
        """Colour goal fragments by the type of the terminal grounded to them, current ones by their own."""
        for node in tree:
            if node.type is None:
                continue
            if node.goal is not None and node.goal < len(self._goal):
                colour = self._goal_colours[node.goal] = tinted(nth_colour(node.type), node.goal)
                self._recolour(f"{blueprint.GOAL}/{node.goal}", self._goal[node.goal], colour)
            if node.now is not None and node.now < len(self._met):
                name = self._met[node.now]
                colour = tinted(nth_colour(node.type), name)
                self._recolour(f"{blueprint.NOW}/{name}", self._now[name], colour)
                self._recolour(f"{blueprint.CLOUDS}/{name}", None, colour)

    def _show_cut(self, plane: Plane, meant: Sequence[int]) -> None:
        corners = quad(plane, [self._now[name] for name in meant])
        self._log(
            f"{blueprint.CUT}/plane",
            rr.Mesh3D(
                vertex_positions=corners,
                triangle_indices=[[0, 1, 2], [0, 2, 3]],
                albedo_factor=(*PLANE, 110),
                face_rendering="DoubleSided",
            ),
        )
        outline = np.vstack([corners, corners[:1]])
        self._log(f"{blueprint.CUT}/outline", rr.LineStrips3D([outline], colors=PLANE, radii=rr.Radius.ui_points(1.5)))
        self._log(
            f"{blueprint.CUT}/meant",
            rr.Points3D(
                [self._now[name].p_WC for name in meant],
                labels=[f"#{name}" for name in meant],
                colors=PLANE,
                radii=rr.Radius.ui_points(3.0),
            ),
        )

    def _clear_cut(self) -> None:
        self._log(blueprint.CUT, rr.Clear(recursive=True))

    def _show_pairs(self, pairs: Sequence[tuple[int, int, float]]) -> None:
        """Goal and reached fragments side by side, matched pairs joined by lines as in Fig. 5.

        In the other views what was reached takes the colour of the goal fragment it is matched with.
        """
        names, reached = list(self._now), list(self._now.values())
        if not reached or not pairs:
            return
        matched = {i: j for i, j, _ in pairs}
        for i, name in enumerate(names):
            colour = self._goal_colours[matched[i]] if i in matched else QUIET
            self._recolour(f"{blueprint.NOW}/{name}", reached[i], colour)
            self._recolour(f"{blueprint.CLOUDS}/{name}", None, colour)
        beside = aside(reached, self._goal)
        best = {("reached", i): iou for i, _, iou in pairs} | {("goal", j): iou for _, j, iou in pairs}
        for side, fragments, shift in (("reached", reached, np.zeros(3)), ("goal", self._goal, beside)):
            for i, fragment in enumerate(fragments):
                iou = best.get((side, i))
                path = f"{blueprint.MATCHED}/{side}/{i}"
                self._log(path, *shape_of(fragment, QUIET if iou is None else graded(iou)))
                self._log(path, pose_of(fragment, shift))
        lines = [np.stack([reached[i].p_WC, self._goal[j].p_WC + beside]) for i, j, _ in pairs]
        self._log(
            f"{blueprint.MATCHED}/lines",
            rr.LineStrips3D(
                lines,
                colors=[graded(iou) for *_, iou in pairs],
                labels=[f"{iou:.2f}" for *_, iou in pairs],
                radii=rr.Radius.ui_points(1.0),
            ),
        )

    # --- where and when -----------------------------------------------------------------------------------------------

    def _nearest(self, p_W: Floats) -> int:
        return min(self._now, key=lambda name: (float(np.linalg.norm(self._now[name].p_WC - p_W)), name))

    def _recolour(self, path: str, fragment: Fragment | None, colour: Colour) -> None:
        """Give a mesh, or points where there is no mesh, another colour, if it is another."""
        if self._colours.get(path) == colour:
            return
        self._colours[path] = colour
        meshed = fragment is not None and isinstance(fragment.shape, Mesh)
        self._log(
            path,
            rr.Mesh3D.from_fields(albedo_factor=colour) if meshed else rr.Points3D.from_fields(colors=colour),
        )

    def _tick(self, ticks: int = 1) -> None:
        self._round += ticks
        self._seconds += PAUSE
        self._at()

    def _at(self) -> None:
        self._out.set_time("step", sequence=self._step)
        self._out.set_time("round", sequence=self._round)
        self._out.set_time("time", duration=self._seconds)

    def _say(self, level: str, text: str) -> None:
        self._log(blueprint.LOG, rr.TextLog(text, level=level))

    def _log(self, path: str, *what: Any, static: bool = False) -> None:
        self._out.log(path, *what, static=static, strict=True)


def make_recorder(path: str, title: str, start: Configuration, goal: Configuration) -> Recorder:
    """An observer that writes a trial to the rerun file `path`; call its `close()` when the trial is over.

    Args:
        path: where the file will stand; its folder is made.
        title: what the recording is called, e.g. "N1M1, trial 12, in-place, grammar, run 0".
        start: the initial configuration, in the world frame.
        goal: the goal's fragments.
    """
    return Recorder(Path(path), title, start, goal)


def _recording_id(title: str, start: Configuration, goal: Configuration) -> str:
    parts = [title, *map(shape_digest, start), "->", *map(shape_digest, goal)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]
