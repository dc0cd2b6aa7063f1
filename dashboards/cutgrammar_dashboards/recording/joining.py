"""One recording made of several untrusted ones, in a process of its own: `comparison_process`."""

import sys
import warnings
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from cutgrammar.untrusted.parser_processes import REFUSED
from cutgrammar_dashboards.recording.blueprint import ARM, BLADE, CUT, GOAL, NOW, OUTCOME, SEARCH, TREE, space
from cutgrammar_dashboards.recording.writer import APPLICATION


def join(given: dict[str, Any]) -> int:
    """Write a recording.

    Args:
        given: what `comparison_process` is given.

    Returns:
        The exit code; `REFUSED` if a file cannot be read, which is told on stderr.
    """
    title, names = given["title"], [name for name, _, _ in given["columns"]]
    stream = rr.RecordingStream(APPLICATION, recording_id=f"{title}: {', '.join(names)}")
    stream.set_log_time_enabled(False)
    stream.send_recording_name(title)
    columns = []
    for name, place, file in given["columns"]:
        try:
            paths = _copy(Path(file), place, stream)
        except (ValueError, OSError, RuntimeError) as error:
            print(f"{file} is no recording that can be read: {' '.join(str(error).split())}", file=sys.stderr)
            return REFUSED
        columns.append(_column(name, place, has_arm=any(path.startswith(f"/{ARM}/") for path in paths)))
    layout = rrb.Blueprint(
        rrb.Horizontal(*columns),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="step", play_state="paused"),
        auto_layout=False,
        auto_views=False,
    )
    stream.save(Path(given["out"]), default_blueprint=layout)
    stream.flush()
    stream.disconnect()
    return 0


def _copy(file: Path, place: str, stream: rr.RecordingStream) -> set[str]:
    """Send all of a recording to `stream`, below the path `place`; the paths that it had."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "RRD file has no footer")  # see `FileWriter.close`
        chunks = RrdReader(file).stream().to_chunks()
    own = [chunk for chunk in chunks if not chunk.entity_path.startswith("/__")]
    stream.send_chunks([chunk.with_entity_path(f"/{place}{chunk.entity_path.rstrip('/')}") for chunk in own])
    return {chunk.entity_path for chunk in own}


def _column(name: str, place: str, has_arm: bool) -> Any:
    """Fragments, goal, parse tree, score and outcome of one trial, from the top to the bottom."""

    def at(*paths: str) -> list[str]:
        return [f"{place}/{path}" for path in paths]

    now = [space(f"{name}: current fragments", *at(NOW, CUT), origin=place)]
    if has_arm:
        now.append(space(f"{name}: the arm at work", *at(ARM, BLADE, NOW, CUT), origin=place))
    return rrb.Vertical(
        rrb.Tabs(*now, active_tab=0),
        space("Goal", *at(GOAL), origin=f"{place}/{GOAL}"),
        rrb.GraphView(name="Parse tree", origin=f"/{place}/{TREE}"),
        rrb.TimeSeriesView(name="Best score over the rounds of search", origin=f"/{place}/{SEARCH}"),
        rrb.TextDocumentView(name="Outcome", origin=f"/{place}/{OUTCOME}"),
        row_shares=[5, 3, 4, 2, 3],
        name=name,
    )
