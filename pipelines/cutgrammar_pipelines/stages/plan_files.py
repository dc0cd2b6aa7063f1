"""A plan as plain data in the frames of the user's files, and the files that hold it."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from cutgrammar.atomic_files import json_bytes, write_atomic
from cutgrammar.events import CutMade, Event, GaveUp, Planned, Scored
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.mesh_io.files import Scan
from cutgrammar.geometry.mesh_io.placing import FileFrame, Placed, Source
from cutgrammar.interfaces import Cut
from cutgrammar_dashboards.figures.layout.sheet import write_sheet
from cutgrammar_dashboards.figures.plan_picture import PlanStep, draw_plan, draw_step
from cutgrammar_pipelines.config import PlanConfig

SCHEMA = 2


@dataclass(frozen=True, eq=False)
class Plan:
    """A whole plan.

    Attributes:
        facts: what the JSON file holds.
        steps: the cuts, to be drawn.
        goal, reached: the configurations at the end.
        events: all that happened.
    """

    facts: dict[str, Any]
    steps: tuple[PlanStep, ...]
    goal: Configuration
    reached: Configuration
    events: tuple[Event, ...]

    @property
    def cuts(self) -> list[dict[str, Any]]:
        """The cuts as plain data."""
        return list(self.facts["cuts"])

    @property
    def stuck(self) -> str | None:
        """Why the plan does not reach the goal's number of fragments; None if it does."""
        reason = self.facts["stuck"]
        return None if reason is None else str(reason)

    @property
    def bodies(self) -> dict[str, int]:
        """Number of bodies in every file of current fragments."""
        return {file["file"]: file["bodies"] for file in self.facts["now"]}


def plan_of(
    config: PlanConfig,
    model: str | None,
    now: Sequence[Scan],
    goal: Sequence[Scan],
    placed: Placed,
    events: Sequence[Event],
) -> Plan:
    """The plan that the events of a trial on the bench make.

    Args:
        config: the request.
        model: digest of the model; None without one.
        now, goal: what was read.
        placed: the same in the world frame.
        events: of the trial.
    """
    before, cuts, steps = placed.now, list[dict[str, Any]](), list[PlanStep]()
    # A product keeps the pose of what it was cut from, the very object, which tells the file it came from.
    sources = {id(fragment.X_WF): source for fragment, source in zip(placed.now, placed.sources, strict=True)}
    n_cuts = sum(isinstance(event, CutMade) for event in events)
    planned: Cut | None = None
    for event in events:
        if isinstance(event, Planned):
            planned = event.cut
        elif isinstance(event, CutMade) and planned is not None:
            targets = tuple(dict.fromkeys(_nearest(before, point) for point in planned.p_WC))
            source = sources[id(before[targets[0]].X_WF)]
            cuts.append(_cut(event.step, planned, before[targets[0]], source))
            title = f"Cut {event.step} of {n_cuts}: {source.path.name}"
            steps.append(PlanStep(title, before, event.configuration, targets, planned.plane_W))
            before = event.configuration
    stuck = next((event.reason for event in events if isinstance(event, GaveUp)), None)
    frames: dict[Path, FileFrame] = {source.path: source.frame for source in placed.sources}
    facts = {
        "schema": SCHEMA,
        "package": version("cutgrammar"),
        "model": model,
        "method": config.method,
        "seed": config.seed,
        "now": [_file(scan, frames[scan.path]) for scan in now],
        "goal": [_file(scan, frame) for scan, frame in zip(goal, placed.goal_frames, strict=True)],
        "notes": list(placed.notes),
        "stuck": stuck,
        "cuts": cuts,
        "score": _score(events, [(scan.path, body) for scan in goal for body in range(len(scan.bodies))]),
    }
    return Plan(facts, tuple(steps), placed.goal, before, tuple(events))


def recording_path(out: Path) -> Path:
    """The recording of a plan that is written to `out`."""
    return _named(out, ".rrd")


def write_plan(plan: Plan, out: Path) -> list[Path]:
    """Write the JSON file and the pictures of a plan; the recording is there already.

    Args:
        plan: the plan.
        out: folder, or the name of the JSON file.

    Returns:
        The files, the recording included.
    """
    main = _named(out, ".json")
    main.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(main, json_bytes(plan.facts))
    files = [main, recording_path(out)]
    score = plan.facts["score"]
    end = "" if score is None else f", expected strict IoU {score['iou_strict']:.2f}"
    cuts = f"{len(plan.steps)} {'cut' if len(plan.steps) == 1 else 'cuts'}"
    text = f"{cuts} to {len(plan.reached)} of {len(plan.goal)} fragments{end}"
    pairs = next((event.pairs for event in plan.events if isinstance(event, Scored)), ())
    picture = draw_plan(plan.steps, plan.goal, plan.reached, [(i, j) for i, j, _ in pairs], "Plan", text)
    write_sheet(picture, _named(out, ".png"))
    files.append(_named(out, ".png"))
    for cut, step in zip(plan.cuts, plan.steps, strict=True):
        normal = ", ".join(f"{number:.3f}" for number in cut["normal"])
        text = f"plane n = ({normal}), d = {cut['offset']:.4g} in the frame and the numbers of {Path(cut['file']).name}"
        files.append(_named(out, f"-step-{cut['step']:02}.png"))
        write_sheet(draw_step(step, text), files[-1])
    return files


def _named(out: Path, ending: str) -> Path:
    folder, stem = (out.parent, out.stem) if out.suffix == ".json" else (out, "plan")
    return folder / f"{stem}{ending}"


def _nearest(configuration: Configuration, p_W: Any) -> int:
    return int(np.argmin([np.linalg.norm(fragment.p_WC - p_W) for fragment in configuration]))


def _cut(step: int, cut: Cut, target: Fragment, source: Source) -> dict[str, Any]:
    plane = source.frame.plane(cut.plane_W)
    why = cut.explanation
    return {
        "step": step,
        "file": str(source.path),
        "body": source.body,
        "normal": plane.normal.tolist(),
        "offset": plane.offset,
        "centroid": source.frame.point(target.p_WC).tolist(),
        "production": why.production if why else None,
        "predicted_iou": why.predicted_iou if why else None,
        "world": {
            "normal": cut.plane_W.normal.tolist(),
            "offset": cut.plane_W.offset,
            "centroid": target.p_WC.tolist(),
        },
    }


def _file(scan: Scan, frame: FileFrame) -> dict[str, Any]:
    return {
        "file": str(scan.path),
        "bodies": len(scan.bodies),
        "notes": list(scan.notes),
        "metres_per_number": frame.scale,
        "rotation_to_world": frame.X_WS.rotation.tolist(),
        "translation_to_world": frame.X_WS.position.tolist(),
    }


def _score(events: Sequence[Event], bodies: Sequence[tuple[Path, int]]) -> dict[str, Any] | None:
    score = next((event for event in events if isinstance(event, Scored)), None)
    if score is None or score.reason is not None:
        return None
    matched = [
        {"reached": i, "goal_file": str(bodies[j][0]), "goal_body": bodies[j][1], "iou": iou}
        for i, j, iou in score.pairs
    ]
    return {"iou_strict": score.iou_strict, "iou": score.scores.get("iou"), "matched": matched}
