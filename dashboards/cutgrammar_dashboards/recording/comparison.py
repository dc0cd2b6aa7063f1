"""One recording that shows the recordings of several trials beside one another."""

import re
import tempfile
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from cutgrammar.atomic_files import put_in_place
from cutgrammar.errors import InputError
from cutgrammar_dashboards.recording.blueprint import ARM, BLADE, CUT, GOAL, NOW, OUTCOME, SEARCH, TREE, space
from cutgrammar_dashboards.recording.writer import APPLICATION


def write_side_by_side(recordings: Mapping[str, Path], title: str, out: Path) -> None:
    """Write one recording with a column for each of `recordings`, whole or not at all.

    All columns follow one timeline: `step`, the number of cuts made.

    Args:
        recordings: name of a column -> file that a `Recorder` wrote.
        title: name of the new recording.
        out: file to write; its folder is created.

    Raises:
        InputError: a file is no recording, or two names differ in punctuation only.
    """
    places = {name: re.sub(r"[^A-Za-z0-9]+", "_", name) for name in recordings}
    if len(set(places.values())) < len(places):
        raise InputError(f"{', '.join(recordings)} cannot be told apart in a recording; compare others")
    out.parent.mkdir(parents=True, exist_ok=True)
    stream = rr.RecordingStream(APPLICATION, recording_id=f"{title}: {', '.join(recordings)}")
    stream.set_log_time_enabled(False)
    stream.send_recording_name(title)
    columns = []
    for name, file in recordings.items():
        paths = _copy(file, places[name], stream)
        columns.append(_column(name, places[name], has_arm=any(path.startswith(f"/{ARM}/") for path in paths)))
    layout = rrb.Blueprint(
        rrb.Horizontal(*columns),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="step", play_state="paused"),
        auto_layout=False,
        auto_views=False,
    )
    with tempfile.TemporaryDirectory(dir=out.parent) as folder:
        partial = Path(folder) / "comparison.rrd"
        stream.save(partial, default_blueprint=layout)
        stream.flush()
        stream.disconnect()
        put_in_place(partial, out)


def _copy(file: Path, place: str, stream: rr.RecordingStream) -> set[str]:
    """Send all of a recording to `stream`, below the path `place`; the paths that it had."""
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "RRD file has no footer")  # see `FileWriter.close`
            chunks = RrdReader(file).stream().to_chunks()
    except (ValueError, OSError, RuntimeError) as error:
        raise InputError(f"{file} is no recording that can be read: {error}; record the trial again") from error
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
