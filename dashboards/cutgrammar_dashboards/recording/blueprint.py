"""The layout in which a recording opens in rerun: fragments beside the goal, the parse tree beside the score, the log.

If a robot made the cuts, the first view shows it, its loads are beside the parse tree, and `time` is the timeline that
plays. If there were cameras, the points that they saw have views of their own.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from cutgrammar.geometry.arrays import Floats
from cutgrammar_dashboards.recording.writer import Writer
from cutgrammar_dashboards.rendering.palette import nth_colour

NOW, GOAL, CUT, TREE, SEARCH, COUNTS, LOG, OUTCOME, MATCHED = (
    "now",
    "goal",
    "cut",
    "tree",
    "score/best_so_far",
    "score/fragments",
    "log",
    "outcome",
    "matched",
)
"""Paths at which things are logged, and which the views show."""

ARM, BLADE, PHASE, TORQUE, VELOCITY, FORCE = (
    "arm",
    "blade/path",
    "motion/phase",
    "motion/torque",
    "motion/velocity",
    "motion/blade_force",
)
EYE_DIRECTION = np.array([0.55, -0.75, 0.5])
"""From the fragments to the eye of the arm's view."""
KNIFE_ABOVE = 0.05
"""How far above the fragments' middle that eye looks, so that the knife is in the picture [m]."""
AWAY, MIN_AWAY = 1.1, 0.25
"""Its distance as a multiple of the diagonal of the box around the fragments, and the smallest [m]."""
SEEN, SEGMENTED = "sight/seen", "sight/segmented"


def trial_blueprint(workplace: Floats, arm: bool = False, sight: bool = False) -> Any:
    """Fragments and goal at the top, parse tree and score in the middle, log and outcome at the bottom.

    Args:
        workplace: (2, 3) lowest and highest corner of the box around the initial fragments [m].
        arm: whether a robot's motion is recorded; if so, the timeline `time` is shown, otherwise `round`.
        sight: whether points seen by cameras are recorded.
    """
    now = [space("Current fragments", NOW, CUT)]
    if arm:
        now.insert(0, space("The arm at work", ARM, BLADE, NOW, CUT, eye=eye_on(workplace)))
    if sight:
        now += [space("Seen by the cameras", SEEN), space("Segmented", SEGMENTED, CUT)]
    score = rrb.TimeSeriesView(name="Best score over the rounds of search", origin=f"/{SEARCH}")
    count = rrb.TimeSeriesView(name="Number of fragments", origin=f"/{COUNTS}")
    no_legend = rrb.PlotLegend(visible=False)
    if arm:
        curves: Any = rrb.Tabs(
            rrb.Vertical(
                rrb.TimeSeriesView(name="Torques, as shares of their limits", origin=f"/{TORQUE}"),
                rrb.TimeSeriesView(
                    name="Velocities, as shares of their limits", origin=f"/{VELOCITY}", plot_legend=no_legend
                ),
                rrb.TimeSeriesView(name="Force on the blade [N]", origin=f"/{FORCE}", plot_legend=no_legend),
                name="Loads of the arm",
            ),
            rrb.Vertical(score, count, name="Search"),
            active_tab=0,
        )
    else:
        curves = rrb.Vertical(score, count)
    outcome = rrb.TextDocumentView(name="Outcome", origin=f"/{OUTCOME}")
    phase = rrb.TextDocumentView(name="What the arm does", origin=f"/{PHASE}")
    timelines = ["time", "step"] if arm else ["step", "round"]
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(
                rrb.Tabs(*now, active_tab=0),
                rrb.Tabs(
                    space("Goal", GOAL, origin=GOAL),
                    space("Matched pairs at the end", NOW, GOAL, MATCHED),
                    active_tab=0,
                ),
                column_shares=[3, 2] if arm else None,
            ),
            rrb.Horizontal(
                rrb.GraphView(
                    name="Parse tree: terminals and the goal fragments they are grounded to", origin=f"/{TREE}"
                ),
                curves,
                column_shares=[1, 1] if arm else [3, 2],
            ),
            rrb.Horizontal(
                rrb.TextLogView(
                    name="What happened",
                    origin=f"/{LOG}",
                    columns=rrb.TextLogColumns(timeline_columns=timelines, text_log_columns=["LogLevel", "Body"]),
                ),
                rrb.Vertical(phase, outcome, row_shares=[2, 3]) if arm else outcome,
                column_shares=[3, 2],
            ),
            row_shares=[6, 5, 3] if arm else [5, 4, 2],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="time" if arm else "round", fps=20.0, play_state="paused"),
        auto_layout=False,
        auto_views=False,
    )


def space(name: str, *contents: str, origin: str = "", eye: Any = None) -> Any:
    """A view of space that shows what is logged at these paths.

    Args:
        name: shown in its title.
        contents: paths.
        origin: path of the frame that the view shows.
        eye: where it is seen from at first; None: from where everything is seen.
    """
    return rrb.Spatial3DView(
        name=name,
        origin=f"/{origin}",
        contents=[f"/{path}/**" for path in contents],
        background=rrb.Background(color=(236, 239, 243, 255)),
        eye_controls=eye,
    )


def eye_on(workplace: Floats) -> Any:
    """An eye so close to the fragments that they and the knife fill the view.

    Args:
        workplace: (2, 3) lowest and highest corner of the box around the fragments [m].
    """
    low, high = workplace
    target = (low + high) / 2.0 + [0.0, 0.0, KNIFE_ABOVE]
    away = max(MIN_AWAY, AWAY * float(np.linalg.norm(high - low)))
    position = target + away * EYE_DIRECTION / np.linalg.norm(EYE_DIRECTION)
    return rrb.EyeControls3D(position=position.tolist(), look_target=target.tolist())


def series_styles(writer: Writer) -> None:
    """Log the names and colours of the series."""
    for path, name, colour, mode in (
        (SEARCH, "best log posterior or predicted IoU", (0, 114, 178), "StepAfter"),
        (f"{COUNTS}/now", "current fragments", (213, 94, 0), "StepAfter"),
        (f"{COUNTS}/goal", "fragments in the goal", (120, 120, 120), "StepAfter"),
    ):
        style = rr.SeriesLines(names=name, colors=colour, widths=2.0, interpolation_mode=mode)
        writer.log(path, style, static=True)


def arm_styles(writer: Writer, joints: Sequence[str]) -> None:
    """Log the names and colours of the series of a robot with these joints."""
    names, colours = list(joints), [nth_colour(i) for i in range(len(joints))]
    for path in (TORQUE, VELOCITY):
        writer.log(path, rr.SeriesLines(names=names, colors=colours, widths=[1.5] * len(names)), static=True)
    writer.log(FORCE, rr.SeriesLines(names="force", colors=(213, 94, 0), widths=2.0), static=True)
