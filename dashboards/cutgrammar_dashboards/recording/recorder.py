"""Records one trial as a rerun file: an observer of its events that needs no viewer, network or telemetry."""

import hashlib
from pathlib import Path

from cutgrammar.events import Event
from cutgrammar.geometry.fragment import Configuration
from cutgrammar_dashboards.recording import blueprint
from cutgrammar_dashboards.recording.fragment_names import shape_digest
from cutgrammar_dashboards.recording.trial_views import TrialViews
from cutgrammar_dashboards.recording.writer import FileWriter


class Recorder:
    """An observer that writes a trial to a rerun file; call `close()` when the trial is over.

    Args:
        path: of the file; its folder is created.
        title: name of the recording, e.g. "N1M1, trial 12, in-place, grammar, run 0".
        start: the initial configuration, in the world frame.
        goal: the goal's fragments.
    """

    def __init__(self, path: str | Path, title: str, start: Configuration, goal: Configuration) -> None:
        self._writer = FileWriter(Path(path), title, _recording_id(title, start, goal))
        self._views = TrialViews(self._writer, title, start, goal)

    def __call__(self, event: Event) -> None:
        """Record one event of the trial."""
        self._views(event)

    def close(self) -> None:
        """Complete the file and give it its name."""
        self._views.flush()
        views = self._views
        self._writer.close(blueprint.trial_blueprint(views.workplace, views.arm is not None, views.has_cameras))


def _recording_id(title: str, start: Configuration, goal: Configuration) -> str:
    parts = [title, *map(shape_digest, start), "->", *map(shape_digest, goal)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]
