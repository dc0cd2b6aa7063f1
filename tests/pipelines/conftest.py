"""A run folder with made-up scores of three setups and four methods, and one of a trial that an arm carried out."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from cutgrammar.demonstration import DemonstratedFragment, Demonstration
from cutgrammar.events import CutMade, Planned, Scored
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Cut
from cutgrammar.motion import Execution
from cutgrammar.storage.ledger import Ledger
from cutgrammar.storage.run_folder import RunFacts, ledger_of, settle_run
from cutgrammar.trials.record import Record, TrialKey, record_of
from cutgrammar_pipelines.inspection import trial_trace
from cutgrammar_workers.trial_worker import TrialTrace

SETUPS = ("N1M1", "N2M1", "N3M4")
LEVEL = {"grammar": 0.6, "largest": 0.4, "random": 0.2, "replay": 0.99}


def facts_of(seed=100, **changes):
    facts = {
        "seed": seed,
        "settings": {"search": {"max_rounds": 50}},
        "data_digest": "d" * 64,
        "missing": (),
        "split": "paper",
        "split_digest": "s" * 64,
        "model_digests": ("m" * 64,),
        "package": "0.1.0",
        "data": "/somewhere/data",
        "models": ("/somewhere/model",),
        "commit": None,
        "machine": {"cpus": 2},
    }
    return RunFacts(**(facts | changes))


def record_for(key, iou, status="done", seconds=1.0, **changes):
    values = {
        "package": "0.1.0",
        "render": None,
        "status": status,
        "reason": None if status == "done" else "the planner saw <b>no</b> cut & stopped",
        "traceback": None,
        "scores": {"iou_strict": 0.9 * (iou or 0.0), "iou": iou},
        "fragments": 5,
        "goal_fragments": 6,
        "cuts": 5,
        "refusals": 1,
        "dead_ends": 1,
        "planning_seconds": seconds / 2,
        "seconds": seconds,
        "events": (),
    }
    return Record(key=key, **(values | changes))


def records_of(facts, setups=SETUPS, methods=tuple(LEVEL), trials=2, runs=2, goals=("in-place",)):
    made = []
    for s, setup in enumerate(setups):
        for trial in range(trials):
            for goal in goals:
                for method in methods:
                    for run in range(runs):
                        key = TrialKey(setup, 10 * s + trial, goal, method, run, "bench", "truth", facts.origin)
                        draw = np.random.default_rng([s, trial, run, *method.encode(), len(goal), facts.seed])
                        iou = float(np.clip(LEVEL[method] + draw.normal(0, 0.08), 0, 1))
                        status = "stuck" if method == "random" and trial == 0 else "done"
                        made.append(record_for(key, iou, status, seconds=float(draw.uniform(0.5, 2))))
    return made


def scored_event(pairs):
    """The last event of a record, as stored: pairs (reached, goal, IoU) of nine fragments each."""
    return {
        "event": "Scored",
        "scores": {},
        "fragments": 9,
        "goal_fragments": 9,
        "reason": None,
        "pairs": [list(pair) for pair in pairs],
    }


def write_run(folder, facts, planned, records):
    settle_run(folder, facts)
    with Ledger(ledger_of(folder)) as ledger:
        ledger.plan(record.key for record in planned)
        for record in records:
            ledger.add(record)
    return folder


@pytest.fixture(scope="session")
def made():
    """Makers of runs with made-up scores."""
    return SimpleNamespace(
        setups=SETUPS,
        level=LEVEL,
        facts_of=facts_of,
        record_for=record_for,
        records_of=records_of,
        scored_event=scored_event,
        write_run=write_run,
    )


@pytest.fixture(scope="session")
def scored_run(tmp_path_factory):
    """A finished run."""
    facts = facts_of()
    records = records_of(facts)
    return write_run(tmp_path_factory.mktemp("runs") / "run", facts, records, records)


def block(x):
    mesh = trimesh.creation.box((0.04, 0.03, 0.02))
    return Fragment(Mesh(mesh.vertices, mesh.faces), Pose(np.eye(3), np.array([x, 0.0, 0.01])))


@pytest.fixture
def arm_events(make_motion):
    one, two = (block(0.0),), (block(-0.02), block(0.02))
    cut = Cut(Plane(np.array([1.0, 0, 0]), 0.0), np.zeros((1, 3)))
    how = Execution(None, 0.0, 0.0, 0.01, 0.02, 4.0, 25.0, 0.6, 0.4, True)
    motion = make_motion(one, two, np.zeros(3), hertz=60)
    return [Planned(1, 0, cut, 0.1), CutMade(1, 2, two, how, motion), Scored({"iou_strict": 1.0, "iou": 1.0}, 2, 2, ())]


@pytest.fixture
def arm_run(made, tmp_path, arm_events):
    """A run of two trials, one by an arm and one on the bench."""
    facts = made.facts_of()
    bench = made.records_of(facts, setups=["N1M1"], methods=["grammar"], trials=1, runs=1)[0]
    arm = record_of(dataclasses.replace(bench.key, world="kinova"), arm_events, package="0.1.0", seconds=1.0)
    cut = {"event": "CutMade", "step": 1, "products": 2, "fragments": 2}
    records = [arm, dataclasses.replace(bench, events=(cut,))]
    return made.write_run(tmp_path / "run", facts, records, records)


@pytest.fixture
def carried_out(monkeypatch, arm_run):
    """Makes the given events what happens when a trial is carried out again."""

    def give(events):
        def worker_for(folder, keys):
            record = record_of(keys[0], events, package="0.1.0", seconds=2.0)
            start = events[1].motion.phases[0].fragments if events[1].motion else ()
            job = SimpleNamespace(demonstration=halved_carrot(events[1].configuration))
            return FixedWorker(TrialTrace(start, events[1].configuration, tuple(events), record)), [job]

        monkeypatch.setattr(trial_trace, "worker_for", worker_for)

    return give


def halved_carrot(halves):
    """A demonstration in which a carrot was cut into these two fragments."""
    whole = block(0.0)
    made = [DemonstratedFragment(0, None, 0, None, whole.mesh)]
    made += [DemonstratedFragment(i, 0, 1, "chunks", half.mesh) for i, half in enumerate(halves, start=1)]
    poses = {(0, 0): whole.X_WF} | {(1, i): half.X_WF for i, half in enumerate(halves, start=1)}
    return Demonstration(0, "N1M1", ("carrot",), ("chunks",), "scripted", 0, tuple(made), poses, ())


@pytest.fixture(scope="session")
def halved():
    """Makes a demonstration: see `halved_carrot`."""
    return halved_carrot


class FixedWorker:
    def __init__(self, trace):
        self._trace = trace

    def carry_out(self, job):
        return self._trace
