"""The worlds of a run's workers, each in a place of its own in the viewer."""

import rerun as rr

from cutgrammar.events import CutFailed, CutMade, CutRefused, Event, GaveUp, Planned, Scored
from cutgrammar.interfaces import Sighted
from cutgrammar.trials.news import TrialBegan, TrialEvent
from cutgrammar_dashboards.live.live_writer import LiveWriter
from cutgrammar_dashboards.recording import blueprint
from cutgrammar_dashboards.recording.scene import markdown
from cutgrammar_dashboards.recording.trial_views import TrialViews
from cutgrammar_dashboards.recording.writer import PAUSE

HEADLINE = "headline"
MAX_SHOWN = 9
"""Workers whose worlds are shown; more would be too small to see."""
OF_A_TRIAL = (
    blueprint.NOW,
    blueprint.GOAL,
    blueprint.CUT,
    blueprint.TREE,
    blueprint.MATCHED,
    blueprint.BLADE,
    blueprint.SEEN,
    blueprint.SEGMENTED,
)
"""Paths that are cleared when the next trial begins."""

AFTER_CLEAR = 1e-3
"""Time between a clear and what is shown there next [s]: the viewer drops poses of the moment of a clear."""


def place_of(slot: int) -> str:
    """The path of a worker's world."""
    return f"worker_{slot + 1}"


class Worlds:
    """Shows the trials of workers as they happen.

    Args:
        stream: to the viewer.
        count: number of workers to show.
    """

    def __init__(self, stream: rr.RecordingStream, count: int) -> None:
        self._writers = [LiveWriter(stream, place_of(slot)) for slot in range(min(count, MAX_SHOWN))]
        self._views: list[TrialViews | None] = [None] * len(self._writers)
        self._titles = [""] * len(self._writers)
        self._slots: dict[str, int] = {}
        self._heard = [0.0] * len(self._writers)

    def begin(self, news: TrialBegan, elapsed: float) -> None:
        """Show the start and the goal of a worker's next trial."""
        slot = self._slot_of(news.worker, elapsed)
        if slot is None:
            return
        writer, before = self._writers[slot], self._views[slot]
        writer.spread(elapsed, elapsed, PAUSE)
        for path in OF_A_TRIAL:
            writer.log(path, rr.Clear(recursive=True))
        elapsed += AFTER_CLEAR
        self._heard[slot], self._titles[slot] = elapsed, news.title
        writer.spread(elapsed, elapsed, PAUSE)
        arm = None if before is None else before.arm
        self._views[slot] = TrialViews(writer, news.title, news.start, news.goal, arm)
        self._say(slot, f"{len(news.start)} to be cut into {len(news.goal)} fragments")

    def show(self, news: TrialEvent, elapsed: float) -> None:
        """Show an event, unless the beginning of its trial was lost."""
        slot = self._slots.get(news.worker)
        if slot is None or self._titles[slot] != news.title:
            return
        writer, views, event = self._writers[slot], self._views[slot], news.event
        assert views is not None
        motion = event.motion if isinstance(event, CutMade) else None
        length = PAUSE if motion is None else PAUSE + float(motion.times[-1])
        writer.spread(self._heard[slot], elapsed, length)
        self._heard[slot] = elapsed
        views(event)
        views.flush()
        writer.spread(elapsed, elapsed, PAUSE)
        self._say(slot, _in_words(event))

    def _say(self, slot: int, text: str) -> None:
        self._writers[slot].log(HEADLINE, markdown(f"**{self._titles[slot]}**: {text}"))

    def _slot_of(self, worker: str, elapsed: float) -> int | None:
        """The place of a worker; one that has none takes a free place, or that of a worker which died."""
        if worker not in self._slots:
            free = [slot for slot in range(len(self._writers)) if slot not in self._slots.values()]
            if not free:
                silent = min(self._slots, key=lambda name: self._heard[self._slots[name]])
                if elapsed - self._heard[self._slots[silent]] < SILENT_SECONDS:
                    return None
                free = [self._slots.pop(silent)]
            self._slots[worker] = free[0]
        return self._slots[worker]


SILENT_SECONDS = 120.0
"""A worker that was not heard of for so long gives its place to one that has none [s]."""


def _in_words(event: Event) -> str:
    match event:
        case Sighted():
            return f"before cut {event.step}, the cameras saw {len(event.configuration)} fragments"
        case Planned(cut=cut):
            why = f", {cut.explanation.production}" if cut.explanation is not None else ""
            return f"cut {event.step} is made{why}"
        case CutMade():
            return f"cut {event.step} was made, {len(event.configuration)} fragments now; the next is planned"
        case CutRefused() | CutFailed():
            return f"cut {event.step} {'refused' if isinstance(event, CutRefused) else 'failed'}: {event.reason}"
        case GaveUp():
            return f"gave up at cut {event.step}: {event.reason}"
        case Scored():
            return f"strict IoU {event.iou_strict:.3f}, {event.fragments} fragments of {event.goal_fragments}"
