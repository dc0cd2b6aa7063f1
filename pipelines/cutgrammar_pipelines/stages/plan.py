"""Plan the cuts for a user's own fragments, from the current ones to a goal."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from cutgrammar.errors import InputError
from cutgrammar.events import CutMade, Event, Observer, Scored
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.geometry.mesh_io.files import Scan, read_scan
from cutgrammar.geometry.mesh_io.placing import place
from cutgrammar.geometry.mesh_io.units import metres_of
from cutgrammar.learning.model import load_model
from cutgrammar.methods.method import Method, PlanningContext
from cutgrammar.methods.registry import find_method
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings
from cutgrammar.storage.shared_storage import local_folder
from cutgrammar.trials.run_trial import run_trial
from cutgrammar_dashboards.recording.recorder import Recorder
from cutgrammar_pipelines.config import PlanConfig
from cutgrammar_pipelines.stages.plan_files import Plan, plan_of, recording_path, write_plan
from cutgrammar_pipelines.stages.progress import progress, status
from cutgrammar_sim.worlds.bench import make_world

WITHOUT_MODEL: Literal["halve"] = "halve"
"""Starting plans of `guided` without a model; with one they come from its grammar."""


class NoModel:
    """Stands for the model where none was given; whatever is asked of it is refused."""

    digest = None

    def __init__(self, method: str) -> None:
        self._method = method

    def __getattr__(self, name: str) -> Any:
        """Refuse.

        Raises:
            InputError: always.
        """
        raise InputError(
            f"method {self._method!r} plans with a trained model; give --model, or a method that needs none: "
            "guided, peel, halve, copy, largest, random"
        )


def plan(config: PlanConfig) -> int:
    """Print the cuts that lead from the fragments in `config.now` to those in `config.goal`, and write the plan.

    Returns:
        0, or 1 if the planner is stuck.

    Raises:
        InputError: a file or the method cannot be used, or the goal has fewer fragments than there are now.
    """
    method = find_method(config.method)
    if method.sees_demonstration or method.is_person:
        raise InputError(f"method {config.method!r} needs a demonstration; give one that does not, e.g. guided")
    model: Any = NoModel(config.method) if config.model is None else load_model(local_folder(config.model))
    settings = config.settings
    if config.model is None and settings.fitting.structures not in ("halve", "peel"):
        settings = replace(settings, fitting=replace(settings.fitting, structures=WITHOUT_MODEL))
    scans = _read((*config.now, *config.goal), config)
    now, goal = scans[: len(config.now)], scans[len(config.now) :]
    placed = place(now, goal, config.unit, None if config.length is None else metres_of(config.length), config.up)
    if config.bodies in ("largest", "union") and len(placed.goal) <= len(placed.now):
        raise InputError(
            f"--bodies {config.bodies} leaves one fragment in every file, and so {len(placed.goal)} in the goal, but "
            f"there are {len(placed.now)} now; save the goal's fragments one by one, or use --bodies closed or all"
        )
    if len(placed.goal) < len(placed.now):
        raise InputError(
            f"the goal has {len(placed.goal)} fragments, fewer than the {len(placed.now)} there are now; cuts only add"
        )
    for text in [f"{scan.path}: {text}" for scan in scans for text in scan.notes] + list(placed.notes):
        status(f"NOTE {text}")
    events = _events(method, PlanningContext(model, settings), placed.now, placed.goal, config)
    made = plan_of(config, model.digest, now, goal, placed, events)
    _print(made)
    if config.out is not None:
        for file in write_plan(made, config.out):
            print(file)
    return 0 if made.stuck is None else 1


def _read(files: Sequence[Path], config: PlanConfig) -> list[Scan]:
    with progress("read", len(files)) as advance:
        found = []
        for file in files:
            found.append(read_scan(file, config.bodies))
            advance()
    return found


def _events(
    method: Method, context: PlanningContext, now: Configuration, goal: Configuration, config: PlanConfig
) -> list[Event]:
    """The events of a trial on the bench; the trial is recorded if the plan is to be written."""
    settings: Settings = context.settings
    streams = partial(stream, config.seed, "plan")
    with progress("cut", len(goal) - len(now)) as advance:
        watch: list[Observer] = [lambda event: advance() if isinstance(event, CutMade) else None]
        recorder = None
        if config.out is not None:
            title = f"plan by {config.method}: {', '.join(path.name for path in config.now)}"
            recorder = Recorder(recording_path(config.out), title, now, goal)
            watch.append(recorder)
        planner = method.planner(context)
        events = run_trial(now, goal, planner, make_world(settings, streams), watch, streams, settings.trial)
        if recorder is not None:
            recorder.close()
    return events


def _print(made: Plan) -> None:
    for cut in made.cuts:
        normal = " ".join(f"{number:+.3f}" for number in cut["normal"])
        where = " ".join(f"{round(number, 9) + 0.0:.4g}" for number in cut["centroid"])
        body = f", body {cut['body'] + 1}" if made.bodies[cut["file"]] > 1 else ""
        why = f"; {cut['production']}" if cut["production"] else ""
        print(f"{cut['step']:3}  {cut['file']}{body}, at ({where}): n = {normal}, d = {cut['offset']:+.4g}{why}")
    if not made.cuts and made.stuck is None:
        print("nothing to cut: there are as many fragments as the goal has")
    if made.stuck is not None:
        print(f"stuck after {len(made.cuts)} cuts: {made.stuck}")
    score = next((event for event in made.events if isinstance(event, Scored)), None)
    if score is not None and score.reason is None:
        print(f"expected strict IoU {score.iou_strict:.2f} with {score.fragments} of {score.goal_fragments} fragments")
