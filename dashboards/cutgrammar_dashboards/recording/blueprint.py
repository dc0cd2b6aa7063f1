"""The layout in which a recording opens in rerun: fragments beside the goal, the parse tree beside the score, the log.

If a robot made the cuts, the first view shows it, its loads are beside the parse tree, and `time` is the timeline that
plays. If there were cameras, the points that they saw have views of their own.
"""

from collections.abc import Sequence
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from cutgrammar_dashboards.rendering.palette import nth_colour

NOW, CLOUDS, GOAL, CUT, TREE, SEARCH, COUNTS, LOG, OUTCOME, MATCHED = (
    "now",
    "clouds",
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
SEEN, SEGMENTED = "sight/seen", "sight/segmented"


def trial_blueprint(arm: bool = False, sight: bool = False) -> Any:
    """Fragments and goal at the top, parse tree and score in the middle, log and outcome at the bottom.

    Args:
        arm: whether a robot's motion is recorded; if so, the timeline `time` is shown, otherwise `round`.
        sight: whether points seen by cameras are recorded.
    """
    light = rrb.Background(color=(236, 239, 243, 255))

    def space(name: str, *contents: str, eye: Any = None) -> Any:
        return rrb.Spatial3DView(
            name=name,
            origin="/",
            contents=[f"/{path}/**" for path in contents],
            background=light,
            line_grid=rrb.LineGrid3D(visible=True, spacing=0.01, color=(120, 130, 140, 60)),
            spatial_information=rrb.SpatialInformation(target_frame="tf#/", show_axes=False),
            eye_controls=eye,
        )

    now = [space("Current fragments", NOW, CUT), space("Current fragments as points", CLOUDS, CUT)]
    if arm:
        in_front = rrb.EyeControls3D(position=(0.42, -0.66, 0.44), look_target=(-0.2, 0.0, 0.2))
        now.insert(0, space("The arm at work", ARM, BLADE, NOW, CUT, eye=in_front))
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
                rrb.Tabs(space("Goal", GOAL), space("Matched pairs at the end", MATCHED), active_tab=0),
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


def series_styles(recording: Any) -> None:
    """Log the names and colours of the series."""
    for path, name, colour, mode in (
        (SEARCH, "best log posterior or predicted IoU", (0, 114, 178), "StepAfter"),
        (f"{COUNTS}/now", "current fragments", (213, 94, 0), "StepAfter"),
        (f"{COUNTS}/goal", "fragments in the goal", (120, 120, 120), "StepAfter"),
    ):
        style = rr.SeriesLines(names=name, colors=colour, widths=2.0, interpolation_mode=mode)
        recording.log(path, style, static=True)


def arm_styles(recording: Any, joints: Sequence[str]) -> None:
    """Log the names and colours of the series of a robot with these joints."""
    names, colours = list(joints), [nth_colour(i) for i in range(len(joints))]
    for path in (TORQUE, VELOCITY):
        recording.log(path, rr.SeriesLines(names=names, colors=colours, widths=[1.5] * len(names)), static=True)
    recording.log(FORCE, rr.SeriesLines(names="force", colors=(213, 94, 0), widths=2.0), static=True)
