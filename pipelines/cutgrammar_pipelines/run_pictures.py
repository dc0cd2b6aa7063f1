"""Pictures of a run: one inference, what every method reached in one trial of each setup, matched pairs.

Which trials are drawn is decided by a rule, not by eye: in each setup the test trial whose strict IoU, under the first
method, is nearest to the median. Trials are carried out again for it: same seeds, same result.
"""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.methods.model import Model, load_model
from cutgrammar.methods.typical import TypicalFragment
from cutgrammar.seams import CutMade, Planned, Scored
from cutgrammar.trials.goals import GOALS
from cutgrammar.trials.ledger import read_records
from cutgrammar.trials.record import Record
from cutgrammar.trials.run_folder import RunFacts, ledger_of, read_run
from cutgrammar.trials.setups import SETUPS
from cutgrammar_dashboards.fragment_names import shape_digest
from cutgrammar_dashboards.inference_picture import Inference, draw_inference
from cutgrammar_dashboards.methods_picture import Contest, Reached, draw_matching, draw_methods
from cutgrammar_dashboards.sheet import write_sheet
from cutgrammar_pipelines.comparisons import AGAINST
from cutgrammar_pipelines.evaluate import once_more
from cutgrammar_pipelines.pictures import typical_of
from cutgrammar_pipelines.progress import progress
from cutgrammar_workers.world_actor import Story

LEAVES = range(5, 10)
"""Numbers of goal fragments for which an inference is easy to read."""


def pictures_of_run(run: Path, out: Path) -> list[Path]:
    """Draw the run in folder `run` into folder `out`, the paper's Fig. 2, 4 and 5.

    Raises:
        InputError: a run that cannot be read, holds no trial or cannot be carried out again; `out` is a file's name.
    """
    if out.suffix or out.is_file():
        raise InputError(f"--out {out} is a file's name, and a run has several pictures; give a folder")
    facts, name = read_run(run), run.resolve().name
    records = _one_condition(read_records(ledger_of(run)))
    if not records:
        raise InputError(f"{run} holds no trial yet; the evaluate command that made it goes on with it")
    shown = _shown(records)
    explained = _explained(records)
    stories = _stories(run, [*(record for row in shown for record in row), *explained])
    files = []
    if explained:
        files.append(out / "2-inference.png")
        write_sheet(_inference_drawn(stories[explained[0].key.digest], facts), files[-1])
    contests = [_contest([stories[record.key.digest] for record in row]) for row in shown]
    files.append(out / "4-methods.png")
    write_sheet(draw_methods(contests, f"What every method reached: {name}"), files[-1])
    uneven = _uneven(contests)
    files.append(out / "5-matched.png")
    title = f"Matched pairs: {uneven.title}, {uneven.subtitle}, {uneven.results[0].method}"
    write_sheet(draw_matching(uneven, title), files[-1])
    return files


def _one_condition(records: Sequence[Record]) -> list[Record]:
    """Of the first goal condition and run of a world, those of which something came back."""
    told = sorted((r for r in records if r.status != "crashed"), key=lambda r: (r.key.goals != GOALS[0], r.key))
    same = ("goals", "world", "perception", "run")
    return [r for r in told if all(getattr(r.key, name) == getattr(told[0].key, name) for name in same)]


def _shown(records: Sequence[Record]) -> list[list[Record]]:
    """The records drawn: of each setup one trial, all methods."""
    rows = []
    for setup in SETUPS:
        of_setup = [record for record in records if record.key.setup == setup]
        methods = _in_order({record.key.method for record in of_setup})
        if not methods:
            continue
        trial = _typical([record for record in of_setup if record.key.method == methods[0]]).key.trial
        there = {r.key.method: r for r in of_setup if r.key.trial == trial}
        rows.append([there[method] for method in methods if method in there])
    return rows


def _explained(records: Sequence[Record]) -> list[Record]:
    """The record whose inference is drawn, if any holds one: of a goal that is easy to read, if there is one."""
    told = [r for r in records if r.key.method == AGAINST and len([e for e in r.events if e.get("production")]) > 1]
    easy = [record for record in told if record.goal_fragments in LEAVES and record.status == "done"]
    several = [record for record in easy if record.key.setup != "N1M1"]
    return [_typical(several or easy or told)] if told else []


def _typical(records: Sequence[Record]) -> Record:
    """The record with the median strict IoU, the lower of two."""
    return sorted(records, key=lambda record: (record.iou_strict, record.key))[(len(records) - 1) // 2]


def _inference_drawn(story: Story, facts: RunFacts) -> Any:
    model = load_model(Path(facts.model))
    data = Path(facts.data) if facts.data_digest == model.provenance.data else None
    inference = _inference(story, model, typical_of(model, Path(facts.model), data))
    key, cut = story.record.key, len(inference.now) - len(story.start) + 1
    return draw_inference(inference, f"One inference: {key.setup}, trial {key.trial}, {key.goals} goal, cut {cut}")


def _inference(story: Story, model: Model, typical: Sequence[TypicalFragment]) -> Inference:
    """The inference for the second cut that was made at the first attempt, or for the last that was."""
    now, found = story.start, []
    for event, after in pairwise(story.events):
        if isinstance(event, Planned) and event.cut.explanation and isinstance(after, CutMade):
            found.append((now, event.cut, event.cut.explanation, after.configuration))
        if isinstance(event, CutMade):
            now = event.configuration
    now, cut, why, after_cut = found[min(1, len(found) - 1)]
    old = {shape_digest(fragment) for fragment in now}
    return Inference(
        now=now,
        goal=story.goal,
        log_now=_log_types(model, now),
        log_goal=_log_types(model, story.goal),
        cut=cut,
        why=why,
        products=tuple(fragment for fragment in after_cut if shape_digest(fragment) not in old),
        grammar=model.grammar,
        typical=typical,
    )


def _log_types(model: Model, fragments: Configuration) -> Floats:
    return model.classifier.log_probabilities(np.array([model.features(fragment.shape) for fragment in fragments]))


def _in_order(methods: set[str]) -> list[str]:
    """The method that others are compared with first, the others by name."""
    return sorted(methods, key=lambda method: (method != AGAINST, method))


def _stories(run: Path, records: Sequence[Record]) -> dict[str, Story]:
    """The trials of these records carried out again, by the digest of their key."""
    worker, jobs = once_more(run, [record.key for record in records])
    stories = {}
    with progress("draw", len(jobs), 0) as advance:
        for i in range(len(jobs)):
            stories[jobs.keys[i].digest] = worker.story(jobs[i])
            advance()
    return stories


def _contest(stories: Sequence[Story]) -> Contest:
    key = stories[0].record.key
    return Contest(
        title=key.setup,
        subtitle=f"trial {key.trial}",
        start=stories[0].start,
        goal=stories[0].goal,
        results=tuple(_reached(story) for story in stories),
    )


def _reached(story: Story) -> Reached:
    scored = story.events[-1]
    assert isinstance(scored, Scored)
    made = [event for event in story.events if isinstance(event, CutMade)]
    return Reached(
        method=story.record.key.method,
        fragments=made[-1].configuration if made else story.start,
        pairs=scored.pairs,
        iou_strict=scored.iou_strict,
        status=story.record.status,
    )


def _uneven(contests: Sequence[Contest]) -> Contest:
    """The trial and method with the most fragments matched with nothing, the first of equals."""
    every = [
        Contest(contest.title, contest.subtitle, contest.start, contest.goal, (result,))
        for contest in contests
        for result in contest.results
    ]
    return max(every, key=lambda one: abs(len(one.goal) - len(one.results[0].fragments)))
