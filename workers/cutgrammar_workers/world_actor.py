"""The worker of an evaluation: one call carries out one whole trial, from a demonstration to a record."""

import tempfile
import time
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from cutgrammar import plugins, seeds
from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.events import CutMade, Event, Scored
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.interfaces import ParallelMap, Planner, Stream, World, run_serially
from cutgrammar.learning.model import Model
from cutgrammar.methods.method import PlanningContext
from cutgrammar.methods.registry import load_method
from cutgrammar.settings import Settings
from cutgrammar.storage.configurations import TrialConfigurations
from cutgrammar.trials.goals import goal_for
from cutgrammar.trials.record import Record, TrialKey, record_of
from cutgrammar.trials.run_trial import run_trial
from cutgrammar.trials.scores import Score, load_score
from cutgrammar.trials.scoring import score, unknown
from cutgrammar_workers.tasks import Crashed, attempt

PERCEPTIONS = ("truth", "cameras")
"""What planners see: the fragments as they are, or as two depth cameras and a learned segmentation perceive them."""

RECORD = ("none", "failed", "all")
"""Which trials are kept as recordings."""


@dataclass(frozen=True, eq=False)
class EvaluationContext:
    """What all trials of an evaluation have in common.

    Attributes:
        seed: of the evaluation.
        settings: all of them.
        model: what was learned.
        methods: name -> "module:attribute" of the `Method`.
        world: "module:attribute" of the factory of worlds.
        perception: what planners see, one of `PERCEPTIONS`.
        package: version of cutgrammar.
        planners: processes that share each search; 1 plans in the process of the world.
        record: one of `RECORD`.
        recorder: "module:attribute" of the factory of recorders.
        scores: name -> "module:attribute" of the `Score`.
    """

    seed: int
    settings: Settings
    model: Model
    methods: Mapping[str, str]
    world: str
    perception: str
    package: str
    planners: int
    record: str
    recorder: str
    scores: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class Job:
    """A trial to be carried out.

    Attributes:
        key: what decides its result.
        demonstration: from which start and goal are taken.
    """

    key: TrialKey
    demonstration: Demonstration


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of a job.

    Attributes:
        record: of the trial.
        recording: content of the rerun file, where it was to be kept.
        unrecorded: why there is none although it was to be kept, in one line.
        configurations: start, goal and what was reached; None where the last is not known.
    """

    record: Record
    recording: bytes | None
    unrecorded: str | None = None
    configurations: TrialConfigurations | None = None


@dataclass(frozen=True, eq=False)
class Story:
    """A trial with its shapes, for those who look at it.

    Attributes:
        start, goal: the configurations that it was about.
        events: what happened.
        record: of the trial.
    """

    start: Configuration
    goal: Configuration
    events: tuple[Event, ...]
    record: Record

    @property
    def configurations(self) -> TrialConfigurations:
        """Start, goal and what was reached."""
        return TrialConfigurations(self.start, self.goal, _reached(self.start, self.events))


class TrialWorker:
    """Carries out trials, each with a fresh world and a fresh planner."""

    def __init__(self, shared: EvaluationContext) -> None:
        self._shared = shared
        self._make_world = plugins.load(shared.world)
        self._methods = {name: load_method(reference) for name, reference in shared.methods.items()}
        self._make_recorder = plugins.load(shared.recorder) if shared.record != "none" else None
        self._scores: list[Score] = [load_score(reference) for reference in shared.scores.values()]
        self._parallel_map: ParallelMap = run_serially
        if shared.planners > 1:
            from cutgrammar_workers.planner_actor import PlannerCrew  # Ray is not wanted otherwise

            self._parallel_map = PlannerCrew(shared.planners)

    def __call__(self, job: Job) -> Outcome:
        """The record of a trial, whatever happens in it, and its recording if it is to be kept.

        The recording is made of the trial's events once it is over, so that no trouble with it can change the record.

        Raises:
            InputError: what the user gave cannot be used.
        """
        story = self.story(job)
        record = story.record
        if self._make_recorder is None or (self._shared.record == "failed" and record.status == "done"):
            return Outcome(record, None, None, story.configurations)
        recording = attempt(self._recorded, story)
        if isinstance(recording, Crashed):
            return Outcome(record, None, recording.reason, story.configurations)
        return Outcome(record, recording, None, story.configurations)

    def story(self, job: Job) -> Story:
        """A trial carried out, whatever happens in it.

        Raises:
            InputError: what the user gave cannot be used.
        """
        start, goal = job.demonstration.start, self._goal(job)
        events: list[Event] = []
        record = self._carried_out(job, start, goal, events)
        return Story(start, goal, tuple(events), record)

    def _recorded(self, story: Story) -> bytes:
        """The recording of a trial."""
        assert self._make_recorder is not None
        key = story.record.key
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{key.name}.rrd"
            recorder = self._make_recorder(str(path), _title(key), story.start, story.goal)
            for event in story.events:
                recorder(event)
            recorder.close()
            return path.read_bytes()

    def _carried_out(self, job: Job, start: Configuration, goal: Configuration, events: list[Event]) -> Record:
        """The record of a trial; what happens is added to `events`."""
        began = time.perf_counter()
        crash, world = None, None
        try:
            world, goal_seen = self._seen(job, goal)
            run_trial(
                start,
                goal,
                self._planner(job),
                world,
                [events.append],
                self._stream(job.key, "planner", job.key.method),
                self._shared.settings.trial,
                foods=job.demonstration.foods,
                goal_seen=goal_seen,
                scores=self._scores,
            )
        except InputError:
            raise
        except Exception as error:  # noqa: BLE001  # the worker boundary: a crash is a record, not the end of the run
            crash = f"{type(error).__name__}: {error}", traceback.format_exc()
            if not (events and isinstance(events[-1], Scored)):
                reached = _reached(start, events)
                scored = attempt(lambda it: score(it, goal, self._scores), reached)
                if isinstance(scored, Crashed):  # the crash was in a score
                    scored = unknown(len(reached), len(goal), scored.reason, self._scores)
                events.append(scored)
        return record_of(
            job.key,
            events,
            package=self._shared.package,
            render=getattr(world, "render_backend", None),
            seconds=time.perf_counter() - began,
            crash=crash,
        )

    def _seen(self, job: Job, goal: Configuration) -> tuple[World, Configuration]:
        """A fresh world as it is perceived, and the goal as the planner is given it."""
        settings, stream = self._shared.settings, self._stream(job.key, "world")
        world: World = self._make_world(settings, stream)
        if self._shared.perception == "truth":
            return world, goal
        from cutgrammar_sim.worlds.perceived import make_perceiving, scanned_goal  # cameras are not wanted otherwise

        return make_perceiving(world, self._shared.model, settings, stream), scanned_goal(goal, settings)

    def _goal(self, job: Job) -> Configuration:
        return goal_for(job.demonstration, job.key.goals, self._stream(job.key, "goal")())

    def _planner(self, job: Job) -> Planner:
        shared = self._shared
        context = PlanningContext(shared.model, shared.settings, job.demonstration, self._parallel_map)
        return self._methods[job.key.method].planner(context)

    def _stream(self, key: TrialKey, *purpose: str) -> Stream:
        """The streams of a trial for one purpose; but for the planner's, they do not know the method."""
        return partial(seeds.stream, self._shared.seed, key.setup, key.trial, key.goals, key.run, *purpose)


def _reached(start: Configuration, events: Sequence[Event]) -> Configuration:
    """The last configuration known of a trial."""
    made = [event for event in events if isinstance(event, CutMade)]
    return made[-1].configuration if made else start


def _title(key: TrialKey) -> str:
    return f"{key.setup}, trial {key.trial}, {key.goals}, {key.method}, run {key.run}, {key.world}"
