"""A training in a viewer: its curves as they grow, and how far it is."""

import numpy as np
import rerun as rr

from cutgrammar.trials.news import TrainingAdvanced, TrainingBegan
from cutgrammar_dashboards.live.layout import STEP, training_layout
from cutgrammar_dashboards.recording.scene import markdown


class TrainingViews:
    """Shows the training that began.

    Args:
        stream: to the viewer.
        training: what began.
    """

    def __init__(self, stream: rr.RecordingStream, training: TrainingBegan) -> None:
        self._stream, self._training = stream, training
        self._progress: dict[str, str] = {}
        self._curves: list[str] = []
        stream.send_blueprint(training_layout(()))

    def show(self, news: TrainingAdvanced) -> None:
        """Show how far a stage is, and the points that were measured."""
        self._progress[news.stage] = f"{news.done} of {news.total}"
        rows = [f"| {stage} | {done} |" for stage, done in self._progress.items()]
        text = "\n".join([f"**{self._training.name}**", "", "| stage | done |", "|---|---|", *rows])
        self._stream.log("progress", markdown(text), static=True)
        if not news.curve:
            return
        if news.stage not in self._curves:
            self._curves.append(news.stage)
            self._stream.send_blueprint(training_layout(self._curves))
        points = np.array(news.curve)
        # One point continues the curve of its stage; many are the whole curve of one of the stage's trainings.
        path = f"curves/{news.stage}/" + ("so_far" if len(points) == 1 else f"training_{news.done}")
        index = rr.TimeColumn(STEP, sequence=points[:, 0].astype(np.int64))
        self._stream.send_columns(path, indexes=[index], columns=rr.Scalars.columns(scalars=points[:, 1]))
