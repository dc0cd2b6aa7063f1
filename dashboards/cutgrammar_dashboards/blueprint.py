"""How a recording opens in rerun: now beside the goal, the parse tree beside the score, the log below."""

from typing import Any

import rerun as rr
import rerun.blueprint as rrb

NOW, CLOUDS, GOAL, CUT, TREE, SEARCH, COUNTS, LOG, OUTCOME, MATCHED = (
    "now",
    "clouds",
    "goal",
    "cut",
    "tree",
    "score/log_posterior",
    "score/fragments",
    "log",
    "outcome",
    "matched",
)
"""Where each thing is logged; the views below show these paths."""


def trial_blueprint() -> Any:
    """Current | goal on top, parse tree | score in the middle, log | outcome below; `round` is the timeline shown."""
    light = rrb.Background(color=(236, 239, 243, 255))

    def space(name: str, *contents: str) -> Any:
        return rrb.Spatial3DView(
            name=name,
            origin="/",
            contents=[f"/{path}/**" for path in contents],
            background=light,
            line_grid=rrb.LineGrid3D(visible=True, spacing=0.01, color=(120, 130, 140, 60)),
            spatial_information=rrb.SpatialInformation(target_frame="tf#/", show_axes=False),
        )

    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(
                rrb.Tabs(space("Now", NOW, CUT), space("Now, as points", CLOUDS, CUT), active_tab=0),
                rrb.Tabs(space("Goal", GOAL), space("Matched pairs at the end", MATCHED), active_tab=0),
            ),
            rrb.Horizontal(
                rrb.GraphView(
                    name="Parse tree: terminals and the goal fragments they are grounded to", origin=f"/{TREE}"
                ),
                rrb.Vertical(
                    rrb.TimeSeriesView(name="Best log posterior over the rounds of search", origin=f"/{SEARCH}"),
                    rrb.TimeSeriesView(name="Fragments", origin=f"/{COUNTS}"),
                ),
                column_shares=[3, 2],
            ),
            rrb.Horizontal(
                rrb.TextLogView(
                    name="What happened",
                    origin=f"/{LOG}",
                    columns=rrb.TextLogColumns(
                        timeline_columns=["step", "round"], text_log_columns=["LogLevel", "Body"]
                    ),
                ),
                rrb.TextDocumentView(name="Outcome", origin=f"/{OUTCOME}"),
                column_shares=[3, 2],
            ),
            row_shares=[5, 4, 2],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="round", fps=20.0, play_state="paused"),
        auto_layout=False,
        auto_views=False,
    )


def series_styles(recording: Any) -> None:
    """Log the names and colours of the series, once."""
    for path, name, colour, mode in (
        (SEARCH, "best log posterior", (0, 114, 178), "StepAfter"),
        (f"{COUNTS}/now", "fragments now", (213, 94, 0), "StepAfter"),
        (f"{COUNTS}/goal", "fragments in the goal", (120, 120, 120), "StepAfter"),
    ):
        style = rr.SeriesLines(names=name, colors=colour, widths=2.0, interpolation_mode=mode)
        recording.log(path, style, static=True)
