"""Many trials of the arm through Ray actors: memory over time, crashes, and the cost of a simulated step.

    python benchmarks/arm_trials.py [--trials 500] [--workers 2] [--seed 0] [--out trials.json]

Each trial replays one of 20 demonstrations of few cuts in a fresh world, as `evaluate` does. (The caches of shapes are
bounded by the number of shapes, so few demonstrations show what grows with the number of trials.) Every actor reports
its resident memory after each trial; after a fifth of its trials it must stay constant within 5 %. Before that, in this
process, the CPU time of the world's stepping loops is compared with that of a bare loop over the same scenes: the same
arm and fragments, the same targets set, and a step. Ends with exit code 1 if memory grows, a trial crashes, or the
ratio is under 0.8.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cutgrammar import seeds
from cutgrammar.events import CutMade, Scored
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.methods.controls import ReplayPlanner
from cutgrammar.motion import Motion
from cutgrammar.plugins import FOODS, load, reference_of
from cutgrammar.settings import DemonstratorSettings, Settings
from cutgrammar.trials.run_trial import run_trial
from cutgrammar.trials.setups import SETUPS
from cutgrammar_sim.arm.execution.articulation import Articulation, build
from cutgrammar_sim.demonstrator.demonstrate import make_demonstration
from cutgrammar_sim.physics.bodies import Bodies
from cutgrammar_sim.worlds.kinova import KinovaWorld
from cutgrammar_workers.pool import run_all
from cutgrammar_workers.tasks import Crashed

WARM = 0.2
"""Share of an actor's trials after which its memory must stay constant."""
MAX_GROWTH, MIN_RATIO = 0.05, 0.8
DEMONSTRATIONS = 20
TIMED = 5
"""Number of demonstrations over which the stepping loops are timed."""


class Trials:
    """A worker that replays the demonstration of a number."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._foods = {"potato": load(reference_of(FOODS, "potato"))}

    def events(self, trial: int, category: str = "chunks") -> list[Any]:
        """Replay the demonstration `trial` on the arm; the events of the trial."""
        shown = make_demonstration(trial, SETUPS["N1M1"], (category,), self._foods, self._seed, DemonstratorSettings())
        settings, stream = Settings(), partial(seeds.stream, self._seed, "arm trials", trial)
        world = KinovaWorld(settings)
        return run_trial(
            shown.start, shown.goal, ReplayPlanner(shown), world, (), stream, settings.trial, foods=shown.foods
        )

    def __call__(self, trial: int) -> tuple[int, int, int, float]:
        """Process, cuts made, resident memory [bytes] and strict IoU of the trial."""
        events = self.events(trial % DEMONSTRATIONS)
        cuts = sum(isinstance(event, CutMade) for event in events)
        score = next(event for event in events if isinstance(event, Scored))
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return os.getpid(), cuts, pages * os.sysconf("SC_PAGESIZE"), score.iou_strict


class Stopwatch:
    """CPU time spent in one method of a class while the context is open."""

    def __init__(self, owner: Any, name: str) -> None:
        self.spent = 0.0
        self._owner, self._name, self._method = owner, name, getattr(owner, name)

    def __enter__(self) -> "Stopwatch":
        method: Callable[..., Any] = self._method

        def timed(*args: Any, **kwargs: Any) -> Any:
            began = time.process_time()
            try:
                return method(*args, **kwargs)
            finally:
                self.spent += time.process_time() - began

        setattr(self._owner, self._name, timed)
        return self

    def __exit__(self, *error: object) -> None:
        setattr(self._owner, self._name, self._method)


def steps_ratio(trials: Trials) -> tuple[float, int]:
    """Steps a second in the world's loops as a share of those in a bare loop, and how many steps were timed."""
    world, bare, steps = 0.0, 0.0, 0
    trials.events(TIMED, "slices")  # compiles everything before it is timed
    for trial in range(TIMED):
        with Stopwatch(Articulation, "follow") as moving, Stopwatch(Bodies, "settle") as settling:
            events = trials.events(trial, "slices")
        motions = [event.motion for event in events if isinstance(event, CutMade)]
        world += moving.spent + settling.spent
        for number, motion in enumerate(motions):
            spent, made = bare_loop(motion, first=number == 0)
            bare, steps = bare + spent, steps + made
    return bare / world, steps


def bare_loop(motion: Motion, first: bool) -> tuple[float, int]:
    """CPU time of the bare steps of a motion, and their number.

    Args:
        motion: of a cut.
        first: whether the settling of the start counts as well.
    """
    world = KinovaWorld(Settings())
    spent, made = 0.0, 0
    moving, settled = motion.phases[0], motion.phases[-1]
    for phase, until in ((moving, settled.first), (settled, len(motion.times))):
        bodies = Bodies(Settings().world, tgs=False)
        build(bodies.scene, world.arm, world.tool)
        lying = settled.fragments if phase is settled else _untouched(motion)
        entities = [bodies.add(fragment, bodies.shapes(fragment.mesh)) for fragment in lying]
        if phase is moving:
            bodies.hold(entities)
            targets = motion.positions[1:until].tolist()
        else:
            seconds = float(motion.times[-1] - motion.times[settled.first - 1])
            targets = [motion.positions[-1].tolist()] * round(seconds * 240.0)
        spent += _stepped(bodies, targets)
        made += len(targets)
    if first:
        bodies = Bodies(Settings().world, tgs=False)
        build(bodies.scene, world.arm, world.tool)
        entities = [bodies.add(f, bodies.shapes(f.mesh)) for f in moving.fragments]
        began = time.process_time()
        bodies.settle(entities)
        spent += time.process_time() - began
    return spent, made


def _untouched(motion: Motion) -> tuple[Fragment, ...]:
    """The fragments that the arm did not handle, as they lay."""
    after = {id(fragment.shape) for fragment in motion.phases[-1].fragments}
    return tuple(fragment for fragment in motion.phases[0].fragments if id(fragment.shape) in after)


def _stepped(bodies: Bodies, targets: list[list[float]]) -> float:
    """CPU time of setting targets one after another with a step after each."""
    scene = bodies.scene
    joints = scene.get_all_articulations()[0].get_active_joints()
    began = time.process_time()
    for target in targets:
        for joint, angle in zip(joints, target, strict=True):
            joint.set_drive_target(angle)
        scene.step()
    return time.process_time() - began


def main() -> int:
    """Run all trials and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="a JSON file for all figures")
    options = parser.parse_args()
    ratio, steps = steps_ratio(Trials(options.seed))
    print(f"steps a second, as a share of a bare loop's: {ratio:.3f} over {steps} steps", flush=True)
    memory: dict[int, list[int]] = {}
    cuts, crashes, scores = 0, list[str](), list[float]()

    def note(index: int, result: Any) -> None:
        nonlocal cuts
        if isinstance(result, Crashed):
            crashes.append(f"trial {index}: {result.reason}")
            return
        process, made, resident, score = result
        memory.setdefault(process, []).append(resident)
        cuts += made
        scores.append(score)
        done = len(scores) + len(crashes)
        print(f"\r{done} of {options.trials} trials, {cuts} cuts", end="", flush=True, file=sys.stderr)

    run_all(Trials, options.seed, range(options.trials), note, options.workers, None, 1, ())
    print(file=sys.stderr)
    growth = []
    for process, seen in sorted(memory.items()):
        later = seen[int(WARM * len(seen)) :]
        growth.append(max(later) / later[0] - 1.0)
        print(f"actor {process}: {len(seen)} trials, {later[0] / 1e6:.0f} MB warm, at most {max(later) / 1e6:.0f} MB")
    for crash in crashes:
        print(crash)
    figures = {
        "trials": options.trials,
        "cuts": cuts,
        "crashes": len(crashes),
        "actors": len(memory),
        "growth": max(growth, default=0.0),
        "iou_strict": float(np.mean(scores)),
        "steps_ratio": ratio,
    }
    print(json.dumps(figures))
    if options.out is not None:
        options.out.write_text(json.dumps({**figures, "memory": list(memory.values())}))
    sound = not crashes and len(memory) == options.workers
    return 0 if sound and figures["growth"] <= MAX_GROWTH and ratio >= MIN_RATIO else 1


if __name__ == "__main__":
    sys.exit(main())
