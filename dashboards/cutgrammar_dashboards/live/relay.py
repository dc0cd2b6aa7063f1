"""Shows the news of a run in a viewer; runs in a process of its own, which may be slow, stuck or killed."""

import time

from cutgrammar.trials.news import (
    News,
    RunBegan,
    TrainingAdvanced,
    TrainingBegan,
    TrialBegan,
    TrialEvent,
    TrialSaved,
)
from cutgrammar_dashboards.live.connection import Connection
from cutgrammar_dashboards.live.layout import evaluation_layout
from cutgrammar_dashboards.live.scoreboard import Scoreboard
from cutgrammar_dashboards.live.training import TrainingViews
from cutgrammar_dashboards.live.worlds import Worlds


class Relay:
    """A function of news that shows them while a viewer listens.

    Args:
        url: of the viewer.
        patient: wait for the viewer at first, which is being started.
    """

    def __init__(self, url: str, patient: bool = False) -> None:
        self._began = time.monotonic()
        self._connection = Connection(url, patient)
        self._run: RunBegan | None = None
        self._training: TrainingBegan | None = None
        self._scores: Scoreboard | None = None
        self._worlds: Worlds | None = None
        self._curves: TrainingViews | None = None

    def __call__(self, news: News) -> None:
        """Show one thing."""
        elapsed = time.monotonic() - self._began
        if isinstance(news, RunBegan):
            self._run, self._scores = news, Scoreboard(news)
        elif isinstance(news, TrainingBegan):
            self._training = news
        elif isinstance(news, TrialSaved) and self._scores is not None:
            self._scores.add(news)
        if self._connection.renewed():
            self._introduce(elapsed)
        if (stream := self._connection.stream) is None:
            return
        if isinstance(news, TrialBegan) and self._worlds is not None:
            self._worlds.begin(news, elapsed)
        elif isinstance(news, TrialEvent) and self._worlds is not None:
            self._worlds.show(news, elapsed)
        elif isinstance(news, TrialSaved) and self._scores is not None:
            self._scores.show(stream, elapsed, news)
        elif isinstance(news, TrainingAdvanced) and self._curves is not None:
            self._curves.show(news)

    def close(self) -> None:
        """Wait a little until the viewer has everything."""
        self._connection.close()

    def _introduce(self, elapsed: float) -> None:
        """Tell a viewer that has just been found what it shows."""
        stream = self._connection.stream
        assert stream is not None
        if self._run is not None and self._scores is not None:
            stream.send_recording_name(self._run.name)
            stream.send_blueprint(evaluation_layout(self._run))
            self._worlds = Worlds(stream, self._run.workers)
            self._scores.forget_styles()
            self._scores.show(stream, elapsed)
        if self._training is not None:
            stream.send_recording_name(self._training.name)
            self._curves = TrainingViews(stream, self._training)
