"""Plan the cuts for a user's own fragments, from the current ones to a goal."""

import math
from collections.abc import Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import json_bytes, write_atomic
from cutgrammar.errors import InputError
from cutgrammar.events import CutMade, Event, GaveUp, Planned, Scored
from cutgrammar.geometry.fragment import Configuration, Mesh
from cutgrammar.geometry.mesh_io.files import read_scan
from cutgrammar.interfaces import Cut
from cutgrammar.learning.model import Model, load_model
from cutgrammar.methods.method import Method, PlanningContext
from cutgrammar.methods.registry import find_method
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings
from cutgrammar.trials.run_trial import run_trial
from cutgrammar_pipelines.config import PlanConfig
from cutgrammar_pipelines.stages.progress import progress
from cutgrammar_sim.worlds.bench import make_world

SCHEMA = 1


def plan(config: PlanConfig) -> int:
    """Print the cuts that lead from the fragments in `config.now` to those in `config.goal`.

    The JSON file `config.out` holds the planes n.v + d = 0 in the world frame [m].

    Returns:
        0, or 1 if the planner is stuck.

    Raises:
        InputError: a file or the method cannot be used, or the goal has fewer fragments than there are now.
    """
    chosen = find_method(config.method)
    if chosen.sees_demonstration:
        raise InputError(f"method {config.method!r} needs a demonstration; give one that does not, e.g. grammar")
    trained = load_model(config.model)
    start, wanted = _fragments(config.now, config.unit), _fragments(config.goal, config.unit)
    if len(wanted) < len(start):
        raise InputError(
            f"the goal has {len(wanted)} fragments, fewer than the {len(start)} there are now; cuts only add"
        )
    events = _events(chosen, trained, start, wanted, config.settings, config.seed)
    steps = _steps(events)
    for step in steps:
        _print_step(step)
    stuck = next((event.reason for event in events if isinstance(event, GaveUp)), None)
    if stuck is not None:
        print(f"stuck after {len(steps)} cuts: {stuck}")
    score = next((event for event in events if isinstance(event, Scored)), None)
    if score is not None and score.reason is None:
        print(f"expected strict IoU {score.iou_strict:.2f} with {score.fragments} of {score.goal_fragments} fragments")
    if config.out is not None:
        facts = {"schema": SCHEMA, "package": version("cutgrammar"), "model": trained.digest, "method": config.method}
        write_atomic(config.out, json_bytes({**facts, "seed": config.seed, "stuck": stuck, "cuts": steps}))
    return 0 if stuck is None else 1


def _fragments(files: Sequence[Path], unit: str | None) -> Configuration:
    with progress("read", len(files)) as advance:
        found = []
        for file in files:
            found.append(read_scan(file, unit))
            advance()
    return tuple(found)


def _events(
    method: Method, model: Model, start: Configuration, goal: Configuration, settings: Settings, seed: int
) -> list[Event]:
    """The events of a trial on the bench; if any fragment is a point cloud, only the next cut is planned."""
    streams = partial(stream, seed, "plan")
    planner = method.planner(PlanningContext(model, settings))
    if all(isinstance(fragment.shape, Mesh) for fragment in start):
        with progress("cut", len(goal) - len(start)) as advance:
            watch = [lambda event: advance() if isinstance(event, CutMade) else None]
            return run_trial(start, goal, planner, make_world(settings, streams), watch, streams, settings.trial)
    if len(goal) == len(start):
        return []
    answer = planner.next_cut(start, goal, (), streams(1, 0))
    return [Planned(1, 0, answer, math.nan) if isinstance(answer, Cut) else GaveUp(1, answer.reason)]


def _steps(events: Sequence[Event]) -> list[dict[str, Any]]:
    """The last plan of every step, as plain data."""
    last = {event.step: event.cut for event in events if isinstance(event, Planned)}
    return [
        {
            "step": step,
            "normal": cut.plane_W.normal.tolist(),
            "offset": cut.plane_W.offset,
            "centroids": cut.p_WC.tolist(),
            "production": cut.explanation.production if cut.explanation else None,
        }
        for step, cut in sorted(last.items())
    ]


def _print_step(step: dict[str, Any]) -> None:
    normal = " ".join(f"{number:+.3f}" for number in step["normal"])
    place = " ".join(f"{number:+.4f}" for number in step["centroids"][0])
    why = step["production"] or ""
    print(f"{step['step']:3}  plane n = {normal}, d = {step['offset']:+.4f} m; fragment at {place} m; {why}")
