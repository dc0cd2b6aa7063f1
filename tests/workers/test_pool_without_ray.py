"""The pool's own work, with a Ray that is simulated: thousands of workers, and results that come together."""

import math
import time
from collections import Counter

import pytest

import capacity
from cutgrammar_workers import actor_pool
from cutgrammar_workers.actor_pool import ActorPool
from cutgrammar_workers.nodes import Nodes
from cutgrammar_workers.tasks import Crashed
from cutgrammar_workers.worker_actor import Place


class Job:
    def __init__(self, number):
        self.key = number


class Answers:
    """Gives each job's number, so that the pool's results can be compared with its tasks."""

    def __call__(self, job):
        return job.key


@pytest.fixture
def simulated(monkeypatch):
    """A pool of so many workers whose calls all end at once."""

    def make(workers, answer=lambda number: number):
        ray = capacity.SimulatedRay(Answers(), 0.0)
        ray.decoded = lambda content, _: answer(content)
        monkeypatch.setattr(actor_pool, "ray", ray)
        return ActorPool(None, None, workers, 1.0)

    return make


def test_every_task_has_one_result_and_many_results_have_one_pause(simulated):
    results, pauses = [], []
    pool = simulated(500)
    tasks = [Job(number) for number in range(3000)]
    pool.run(tasks, lambda index, result: results.append((index, result)), print, lambda: pauses.append(len(results)))
    assert sorted(results) == [(number, number) for number in range(3000)]
    assert len(pauses) < 100
    assert pauses[0] == 0


def test_a_result_that_was_there_with_a_fault_of_its_worker_is_made_again(simulated):
    """The worker is replaced, so that what it did behind the fault is not taken."""
    faults, left = [], Counter({7: 2})

    def answer(number):
        left[number] -= 1
        return Crashed("the disk is full", "", by_machine=True) if left[number] >= 0 else number

    results = []
    pool = simulated(3, answer)
    pool._has_children = False
    tasks = [Job(number) for number in range(40)]
    pool.run(tasks, lambda index, result: results.append((index, result)), lambda index, _: faults.append(index))
    assert sorted(results) == [(number, number) for number in range(40)]
    assert faults == [7, 7]


def test_waiting_for_a_cpu_is_no_time_of_a_start_and_building_is(monkeypatch):
    def later(actor, due, result):
        if isinstance(result, Place) and not asked:
            due += time.monotonic() + 0.5  # the first actor waits for a CPU
        elif result is False and len(asked) == 2:
            due = math.inf  # the second one is never built
        asked.append(actor)
        return add(actor, due, result)

    ray, asked = capacity.SimulatedRay(Answers(), 0.0), []
    add, ray._add, ray.decoded = ray._add, later, lambda content, _: content
    monkeypatch.setattr(actor_pool, "ray", ray)
    monkeypatch.setattr(actor_pool, "BUILD_SECONDS", 0.05)
    monkeypatch.setattr(Nodes, "is_cut_off", lambda *_: False)
    pool, results = ActorPool(None, None, 2, 1.0, max_start_seconds=0.05), []
    patient, hanging = (actor.handle.actor for actor in pool._actors)
    pool.run([Job(number) for number in range(9)], lambda *result: results.append(result), print)
    assert sorted(results) == [(number, number) for number in range(9)]
    assert hanging in ray._dead
    assert patient not in ray._dead
