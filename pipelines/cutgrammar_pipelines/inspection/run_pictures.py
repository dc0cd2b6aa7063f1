"""Pictures of a run: one inference, what every method reached in one trial of each setup, matched pairs.

Which trials are drawn is decided by a rule, not by eye: in each setup the test trial whose strict IoU, under the first
method, is nearest to the median. Trials are carried out again for it: same seeds, same result.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.events import CutMade, Scored
from cutgrammar.learning.model import Model, load_model
from cutgrammar.learning.typical_fragments import TypicalFragment, typical_fragments
from cutgrammar.results.comparisons import AGAINST
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import RunFacts, ledger_of, read_run
from cutgrammar.trials.goals import GOALS
from cutgrammar.trials.record import Record
from cutgrammar.trials.setups import SETUPS
from cutgrammar_dashboards.figures.inference_picture import draw_inference, tree_of
from cutgrammar_dashboards.figures.layout.sheet import write_sheet
from cutgrammar_dashboards.figures.matching_picture import draw_matching
from cutgrammar_dashboards.figures.methods_picture import Contest, Reached, draw_methods
from cutgrammar_dashboards.figures.sharing_picture import Side, draw_sharing
from cutgrammar_pipelines.inspection.inferences import inference_of
from cutgrammar_pipelines.inspection.pictures import training_trials_of
from cutgrammar_pipelines.inspection.sharing import Sharing, find_sharing
from cutgrammar_pipelines.stages.evaluate import once_more
from cutgrammar_pipelines.stages.progress import progress
from cutgrammar_workers.world_actor import Story

LEAVES = range(5, 10)
"""Numbers of goal fragments for which an inference is easy to read."""
ROW = 9
"""Matched pairs in a row."""


def pictures_of_run(run: Path, out: Path) -> list[Path]:
    """Draw the run in folder `run` into folder `out`: the paper's Fig. 4 and 5, and 1 and 2 if plans were explained.

    Raises:
        InputError: a run that cannot be read, holds no trial or cannot be carried out again; `out` is a file's name.
    """
    if out.suffix or out.is_file():
        raise InputError(f"--out {out} is a file's name, and a run has several pictures; give a folder")
    facts, name = read_run(run), run.resolve().name
    records = _one_condition(read_records(ledger_of(run)))
    if not records:
        raise InputError(f"{run} holds no trial yet; the evaluate command that made it goes on with it")
    told = [record for record in records if record.key.method == AGAINST and _explained_cuts(record)]
    shown, uneven = _shown(records), _uneven(records)
    readable = _readable(told)
    learned = _Learned.of(facts) if told else None
    sharing = find_sharing(told, _foods(facts), learned.model, learned.demonstrations) if learned else None
    wanted = [*(record for row in shown for record in row), uneven]
    wanted += [record for record in (readable, sharing.record if sharing else None) if record]
    stories = _stories(run, wanted)
    drawn: dict[str, Any] = {}
    if learned and sharing:
        drawn["1-sharing.png"] = _sharing_drawn(sharing, stories[sharing.record.key.digest], learned)
    if learned and readable:
        drawn["2-inference.png"] = _inference_drawn(stories[readable.key.digest], learned)
    contests = [_contest([stories[record.key.digest] for record in row]) for row in shown]
    drawn["4-methods.png"] = draw_methods(contests, f"What every method reached: {name}")
    title = f"Matched pairs: {_named(uneven)}, {uneven.key.method}"
    drawn["5-matched.png"] = draw_matching(_contest([stories[uneven.key.digest]]), title, ROW)
    for file, figure in drawn.items():
        write_sheet(figure, out / file)
    return [out / file for file in drawn]


@dataclass(frozen=True, eq=False)
class _Learned:
    """The run's model, the trials it learned from, and the typical fragment of every type."""

    model: Model
    demonstrations: Sequence[Demonstration]
    typical: Sequence[TypicalFragment]

    @staticmethod
    def of(facts: RunFacts) -> "_Learned":
        folder = Path(facts.model)
        model = load_model(folder)
        data = Path(facts.data) if facts.data_digest == model.provenance.data else None
        demonstrations = training_trials_of(model, folder, data)
        return _Learned(model, demonstrations, typical_fragments(model, demonstrations))


def _foods(facts: RunFacts) -> Callable[[int], Sequence[str]]:
    source = DataSet.open(Path(facts.data), allow_missing=bool(facts.missing))
    return lambda trial: source.summary(trial).foods


def _explained_cuts(record: Record) -> list[Any]:
    return [event for event in record.events if event.get("production")]


def _named(record: Record) -> str:
    return f"{record.key.setup}, trial {record.key.trial}, {record.key.goals} goal"


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


def _readable(told: Sequence[Record]) -> Record | None:
    """The record whose inference is drawn, if any holds one: of a goal that is easy to read, if there is one."""
    told = [record for record in told if len(_explained_cuts(record)) > 1] or told
    easy = [record for record in told if record.goal_fragments in LEAVES and record.status == "done"]
    several = [record for record in easy if record.key.setup != "N1M1"]
    return _typical(several or easy or told) if told else None


def _typical(records: Sequence[Record]) -> Record:
    """The record with the median strict IoU, the lower of two."""
    return sorted(records, key=lambda record: (record.iou_strict, record.key))[(len(records) - 1) // 2]


def _inference_drawn(story: Story, learned: _Learned) -> Any:
    """Fig. 2, for the second cut of a trial."""
    inference = inference_of(story, 1, learned.model, learned.typical)
    cut = len(inference.now) - len(story.start) + 1
    return draw_inference(inference, f"One inference: {_named(story.record)}, cut {cut}")


def _sharing_drawn(sharing: Sharing, story: Story, learned: _Learned) -> Any:
    """Fig. 1, for the first cut of a trial."""
    planned = tree_of(inference_of(story, 0, learned.model, learned.typical))
    seen = sharing.demonstration
    before, after = (", ".join(foods) for foods in (seen.foods, sharing.foods))
    return draw_sharing(
        Side(f"seen: {before}", f"training trial {seen.trial}", sharing.seen, seen.start, seen.goal),
        Side(f"planned: {after}", f"{_named(sharing.record)}, the best parse tree", planned, story.start, story.goal),
        sharing.production,
        f"What cutting {before} tells of cutting {after}",
    )


def _in_order(methods: set[str]) -> list[str]:
    """The method that others are compared with first, the others by name."""
    return sorted(methods, key=lambda method: (method != AGAINST, method))


def _stories(run: Path, records: Sequence[Record]) -> dict[str, Story]:
    """The trials of these records carried out again, by the digest of their key."""
    worker, jobs = once_more(run, list(dict.fromkeys(record.key for record in records)))
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


def _uneven(records: Sequence[Record]) -> Record:
    """The record whose matching is drawn: one with unmatched fragments if there is any, of the first method that has.

    Of several, the one whose goal is nearest in size to what fits in a row.
    """
    uneven = [record for record in records if record.fragments not in (None, record.goal_fragments)]
    methods = _in_order({record.key.method for record in uneven or records})
    mine = [record for record in uneven or records if record.key.method == methods[0]]
    return min(mine, key=lambda record: (abs(record.goal_fragments - ROW), record.key))
