"""The worker of an evaluation: one call carries out one trial, from a demonstration to a record."""

import json
import os
import socket
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from cutgrammar import plugins, seeds
from cutgrammar.demonstration import DemonstratedObject, Demonstration
from cutgrammar.errors import InputError
from cutgrammar.events import CutMade, Event, Observer, Scored
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.interfaces import ParallelMap, Planner, Stream, World, run_serially
from cutgrammar.learning.model import Model
from cutgrammar.methods.method import PlanningContext
from cutgrammar.methods.registry import load_method
from cutgrammar.settings import Settings
from cutgrammar.storage.attempts import Attempt
from cutgrammar.storage.configurations import Contents, TrialConfigurations, contents_of
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.shared_storage import local_folder, write_file
from cutgrammar.trials.goals import goal_for
from cutgrammar.trials.news import Outlet, TrialBegan, TrialEvent
from cutgrammar.trials.record import Record, TrialKey, record_of
from cutgrammar.trials.run_trial import run_trial
from cutgrammar.trials.scores import Score, load_score
from cutgrammar.trials.scoring import score, unknown
from cutgrammar_workers.checked_planner import CheckedPlanner
from cutgrammar_workers.tasks import Crashed, attempt, crash_of, is_fault_of_machine
from cutgrammar_workers.versions import PACKAGES, versions_here

PERCEPTIONS = ("truth", "scans", "cameras")
"""What planners see: the true fragments; the goal as point clouds of whole surfaces and the true current fragments; or
the goal so and what two depth cameras and a learned segmentation perceive."""

RECORD = ("none", "failed", "all")
"""Which trials are kept as recordings."""


@dataclass(frozen=True, eq=False)
class EvaluationContext:
    """The data that all trials of an evaluation share.

    Attributes:
        seed: of the evaluation.
        settings: all settings.
        models: origin of trials -> the model that they use.
        methods: name -> "module:attribute" of the `Method`.
        world: "module:attribute" of the factory of worlds.
        perception: what planners see, one of `PERCEPTIONS`.
        package: version of cutgrammar.
        planners: number of processes that share each search; with 1, the process of the world plans.
        record: one of `RECORD`.
        recorder: "module:attribute" of the factory of recorders.
        scores: name -> "module:attribute" of the `Score`.
        data: URL of the data set that a node fetches, once, and its digest; None where jobs bring their demonstrations.
        artifacts: origin of trials -> folder or URL that their recordings are written to; empty where the driver
            writes them.
        outlet: is told what happens in every trial while it happens; None where nobody watches.
        versions: what the driver knows of the versions of this program and of the plugins: name -> version.
    """

    seed: int
    settings: Settings
    models: Mapping[str, Model]
    methods: Mapping[str, str]
    world: str
    perception: str
    package: str
    planners: int
    record: str
    recorder: str
    scores: Mapping[str, str]
    data: tuple[str, str] | None = None
    artifacts: Mapping[str, str] = field(default_factory=dict)
    outlet: Outlet | None = None
    versions: Mapping[str, str] = field(default_factory=dict)

    def alone(self) -> "EvaluationContext":
        """The same for a process without Ray, and so without planners; their number never changes a plan."""
        return replace(self, planners=1)

    def runs_plugins(self, job: "Job") -> bool:
        """Whether code that is not built in takes part in a trial, which could end its process."""
        references = (self.methods[job.key.method], self.world, *self.scores.values())
        return any(reference.partition(":")[0].partition(".")[0] not in PACKAGES for reference in references)

    def versions_by_method(self) -> dict[str, dict[str, str]]:
        """Method -> name -> version, as they are in this process, of all that can change the method's results."""
        references = {f"method {method}": reference for method, reference in self.methods.items()}
        references |= {f"score {name}": reference for name, reference in self.scores.items()} | {"world": self.world}
        every = {**self.versions, **versions_here(references)}
        of_methods = {method: (f"method {method}", f"code of method {method}") for method in self.methods}
        common = set(every).difference(*of_methods.values())
        return {
            method: {name: every[name] for name in sorted(every) if name in common or name in own}
            for method, own in of_methods.items()
        }


@dataclass(frozen=True, eq=False)
class Job:
    """A trial to carry out.

    Attributes:
        key: what determines its result.
        demonstration: gives start and goal; None where workers read it from the context's data set.
        donors: the objects whose fragments are the goal, under foreign goals.
        reproduction: how a person reproduced the goal, for methods that repeat it; the trial then ends with all of
            the person's cuts, whatever number of fragments the goal has.
    """

    key: TrialKey
    demonstration: Demonstration | None
    donors: tuple[DemonstratedObject, ...] = ()
    reproduction: Demonstration | None = None


@dataclass(frozen=True, eq=False)
class Outcome:
    """The result of a job, as it is stored.

    Attributes:
        record: of the trial.
        recording: content of the rerun file; None where the trial is not kept as a recording, or the worker has
            written it to where the context says.
        unrecorded: why the recording failed, in one line; None if it did not.
        configurations: start, goal and the configuration reached, as they are stored; None where the last is not known.
        attempt: who carried it out, when, and with which versions.
    """

    record: Record
    recording: bytes | None
    unrecorded: str | None = None
    configurations: Contents | None = None
    attempt: Attempt = field(default_factory=Attempt)


@dataclass(frozen=True, eq=False)
class TrialTrace:
    """A trial with its shapes, from which recordings and pictures are made.

    Attributes:
        start, goal: the initial and the goal configuration.
        events: what happened, in order.
        record: of the trial.
    """

    start: Configuration
    goal: Configuration
    events: tuple[Event, ...]
    record: Record

    @property
    def configurations(self) -> TrialConfigurations:
        """Start, goal and the configuration reached."""
        return TrialConfigurations(self.start, self.goal, _reached(self.start, self.events))


class TrialWorker:
    """Carries out trials, each with a fresh world and a fresh planner."""

    def __init__(self, shared: EvaluationContext) -> None:
        self._shared = shared
        self._make_world = plugins.load(shared.world)
        self._methods = {name: load_method(reference) for name, reference in shared.methods.items()}
        self._digests = {origin: model.digest for origin, model in shared.models.items()}
        self._make_recorder = plugins.load(shared.recorder) if shared.record != "none" else None
        self._scores: list[Score] = [load_score(reference) for reference in shared.scores.values()]
        self._data = None if shared.data is None else fetched(*shared.data)
        self._versions = shared.versions_by_method()
        self._host = socket.gethostname()
        self._name = f"{self._host}:{os.getpid()}"
        self._parallel_map: ParallelMap = run_serially
        self.wait: Callable[[], None] | None = None
        """Waits until a search can begin, which is no trial's time; None where there is nothing to wait for."""
        if shared.planners > 1:
            from cutgrammar_workers.planner_pool import PlannerPool  # importing Ray takes a second

            self._parallel_map = planners = PlannerPool(shared.planners)
            self.wait = planners.wait

    def __call__(self, job: Job) -> Outcome:
        """Carry out a trial, and make its recording if the context asks for one.

        The recording is made from the trial's events when it is over, so that an error in it cannot change the record.

        Raises:
            InputError: the user's input cannot be used.
        """
        started = time.time()
        trace = self.carry_out(job)
        attempted = Attempt(self._host, os.getpid(), started, time.time(), self._versions[job.key.method])
        is_kept = self._shared.record == "all" or (self._shared.record == "failed" and trace.record.status != "done")
        recording = attempt(self._recording_of, trace) if is_kept else None
        contents = contents_of(trace.configurations)
        if isinstance(recording, Crashed):
            return Outcome(trace.record, None, recording.reason, contents, attempted)
        return Outcome(trace.record, recording, None, contents, attempted)

    def carry_out(self, job: Job) -> TrialTrace:
        """Carry out a trial; whatever happens in it, even an exception, becomes its record.

        Raises:
            InputError: the user's input cannot be used.
        """
        demonstration = self._demonstration_of(job)
        start = demonstration.start
        goal = goal_for(demonstration, job.key.goals, self._stream(job.key, "goal")(), job.donors)
        events: list[Event] = []
        observers: list[Observer] = [events.append]
        if (tell := self._shared.outlet) is not None:
            title = _title(job.key)
            tell(TrialBegan(self._name, title, start, goal))
            observers.append(lambda event: tell(TrialEvent(self._name, title, event)))
        began = time.perf_counter()
        crash, world = None, None
        try:
            world, goal_seen = self._world_and_goal(job, goal)
            run_trial(
                start,
                goal,
                self._planner(job, demonstration),
                world,
                observers,
                self._stream(job.key, "planner", job.key.method),
                self._shared.settings.trial,
                foods=demonstration.foods,
                goal_seen=goal_seen,
                scores=self._scores,
                until=None if job.reproduction is None else len(job.reproduction.goal),
            )
        except InputError:
            raise
        except Exception as error:  # the worker boundary: a crash is a record, not the end of the run
            if is_fault_of_machine(error):
                raise  # it is no result of the method: the trial is repeated
            ended = crash_of(error)
            crash = ended.reason, ended.traceback
            if not (events and isinstance(events[-1], Scored)):
                reached = _reached(start, events)
                scored = attempt(lambda end: score(end, goal, self._scores), reached)
                if isinstance(scored, Crashed):  # the crash was in a score
                    scored = unknown(len(reached), len(goal), scored.reason, self._scores)
                events.append(scored)
        record = record_of(
            job.key,
            events,
            package=self._shared.package,
            model=self._digests[job.key.origin],
            render=getattr(world, "render_backend", None),
            seconds=time.perf_counter() - began,
            crash=crash,
        )
        # What cannot be stored ends this trial here, not the run in the driver.
        json.dumps(record.to_json(), allow_nan=False, ensure_ascii=False).encode()
        return TrialTrace(start, goal, tuple(events), record)

    def _recording_of(self, trace: TrialTrace) -> bytes | None:
        """The content of the trial's rerun file; None where the context has a place for it, to which it is written."""
        assert self._make_recorder is not None
        key = trace.record.key
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{key.name}.rrd"
            recorder = self._make_recorder(str(path), _title(key), trace.start, trace.goal)
            for event in trace.events:
                recorder(event)
            recorder.close()
            if (place := self._shared.artifacts.get(key.origin)) is None:
                return path.read_bytes()
            write_file(place, path.name, path.read_bytes())
            return None

    def _world_and_goal(self, job: Job, goal: Configuration) -> tuple[World, Configuration]:
        """A fresh world, with cameras where they are used, and the goal as the planner perceives it."""
        settings, stream = self._shared.settings, self._stream(job.key, "world")
        world: World = self._make_world(settings, stream)
        if self._shared.perception == "truth":
            return world, goal
        from cutgrammar_sim.worlds.perceived import make_perceiving, scanned_goal  # for clouds only

        if self._shared.perception == "scans":
            return world, scanned_goal(goal)
        return make_perceiving(world, self._shared.models[job.key.origin], settings, stream), scanned_goal(goal)

    def _demonstration_of(self, job: Job) -> Demonstration:
        if job.demonstration is not None:
            return job.demonstration
        assert self._data is not None
        return self._data.demonstration(job.key.trial)

    def _planner(self, job: Job, demonstration: Demonstration) -> Planner:
        shared = self._shared
        model = shared.models[job.key.origin]
        context = PlanningContext(
            model, shared.settings, demonstration, self._parallel_map, job.donors, job.reproduction
        )
        method, reference = self._methods[job.key.method], shared.methods[job.key.method]
        return CheckedPlanner(lambda: method.planner(context), is_plugin=not reference.startswith("cutgrammar."))

    def _stream(self, key: TrialKey, *purpose: str) -> Stream:
        """The random streams of a trial for one purpose; only the planner's depend on the method."""
        return partial(seeds.stream, self._shared.seed, key.setup, key.trial, key.goals, key.run, *purpose)


def fetched(url: str, digest: str) -> DataSet:
    """The data set at a URL, fetched if this node does not have it yet.

    Raises:
        InputError: it cannot be fetched, or has changed since the evaluation began.
    """
    data = DataSet.open(local_folder(url), allow_missing=True, known=digest)
    if data.digest != digest:
        raise InputError(f"{url} has changed since the evaluation began; put the data set back")
    return data


def _reached(start: Configuration, events: Sequence[Event]) -> Configuration:
    """The last known configuration of a trial."""
    made = [event for event in events if isinstance(event, CutMade)]
    return made[-1].configuration if made else start


def _title(key: TrialKey) -> str:
    return f"{key.setup}, trial {key.trial}, {key.goals}, {key.method}, run {key.run}, {key.world}"
