"""The scores so far of a run, method by method."""

import rerun as rr

from cutgrammar.trials.news import RunBegan, TrialSaved
from cutgrammar_dashboards.live.live_writer import ELAPSED
from cutgrammar_dashboards.recording.scene import markdown
from cutgrammar_dashboards.rendering.palette import nth_colour

TABLE, MEANS, SAVED = "scores/table", "scores/means", "scores/saved"


class Scoreboard:
    """Keeps scores, also while no viewer listens.

    Args:
        run: what is known at the beginning.
    """

    def __init__(self, run: RunBegan) -> None:
        self._run = run
        self._scores = {method: list(values) for method, values in run.scored.items()}
        self._ended: dict[str, int] = {}
        self._styled: set[str] = set()

    def add(self, news: TrialSaved) -> None:
        """Count a trial."""
        self._scores.setdefault(news.method, []).append(news.iou_strict)
        if news.status != "done":
            self._ended[news.method] = self._ended.get(news.method, 0) + 1

    def show(self, stream: rr.RecordingStream, elapsed: float, news: TrialSaved | None = None) -> None:
        """Show the table, and what a trial that was saved changed."""
        stream.set_time(ELAPSED, duration=elapsed)
        stream.log(TABLE, markdown(self._table(elapsed)))
        for method in [news.method] if news else list(self._scores):
            if method not in self._styled:
                self._styled.add(method)
                colour = nth_colour(list(self._scores).index(method))
                stream.log(f"{MEANS}/{method}", rr.SeriesLines(names=method, colors=colour, widths=2.0), static=True)
            stream.log(f"{MEANS}/{method}", rr.Scalars(_mean(self._scores[method])))
        if news is not None:
            level = "INFO" if news.status == "done" else "WARN"
            stream.log(SAVED, rr.TextLog(f"{news.title}: {news.status}, strict IoU {news.iou_strict:.3f}", level=level))

    def forget_styles(self) -> None:
        """There is another viewer."""
        self._styled = set()

    def _table(self, elapsed: float) -> str:
        done = sum(map(len, self._scores.values()))
        best_first = sorted(self._scores, key=lambda method: (-_mean(self._scores[method]), method))
        return "\n".join(
            [
                f"**{self._run.name}**: {done} of {self._run.planned} trials, {elapsed:.0f} s",
                "",
                "| method | trials | mean strict IoU | not done |",
                "|---|---|---|---|",
                *(
                    f"| {method} | {len(self._scores[method])} | {_mean(self._scores[method]):.3f} "
                    f"| {self._ended.get(method, 0)} |"
                    for method in best_first
                ),
            ]
        )


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)
