"""Pictures of a run: one inference, the results of all methods in one trial of each setup, matched pairs.

Configurations come from the ledger. A trial is reproduced, with the same seeds and so the same result, if its parse
tree is drawn or the ledger does not hold its configurations.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.learning.model import Model, load_model
from cutgrammar.learning.typical_fragments import TypicalFragment, typical_fragments
from cutgrammar.results.comparisons import AGAINST
from cutgrammar.storage.configurations import TrialConfigurations
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.ledger import read_configurations, read_records
from cutgrammar.storage.run_folder import RunFacts, ledger_of, read_run, refuse_test_robots
from cutgrammar.storage.shared_storage import absolute, local_folder
from cutgrammar.trials.record import Record, TrialKey
from cutgrammar_dashboards.figures.inference_picture import draw_inference, tree_of
from cutgrammar_dashboards.figures.layout.sheet import write_sheet
from cutgrammar_dashboards.figures.matching_picture import draw_matching
from cutgrammar_dashboards.figures.methods_picture import MethodResult, TrialResults, draw_methods
from cutgrammar_dashboards.figures.sharing_picture import Side, draw_sharing
from cutgrammar_pipelines.inspection.chosen_trials import (
    PAIRS_PER_ROW,
    explained_cuts,
    median_trials,
    one_condition,
    readable_inference,
    uneven_matching,
)
from cutgrammar_pipelines.inspection.inferences import inference_of
from cutgrammar_pipelines.inspection.pictures import training_trials_of
from cutgrammar_pipelines.inspection.sharing import Sharing, find_sharing
from cutgrammar_pipelines.stages.evaluate.reproduce import worker_for
from cutgrammar_pipelines.stages.progress import progress
from cutgrammar_workers.trial_worker import TrialTrace


def pictures_of_run(place: str | Path, out: Path) -> list[Path]:
    """Draw the run at `place` into folder `out`: the paper's Fig. 4 and 5, and 1 and 2 if plans were explained.

    `place` is a folder or a URL.

    Raises:
        InputError: the run cannot be read, holds no trial, cannot be reproduced or repeats what a test robot did,
            or `out` is a file name.
    """
    if out.suffix or out.is_file():
        raise InputError(f"--out {out} is a file name, but a run has several pictures; give a folder")
    run, name = local_folder(place), Path(absolute(place)).name
    facts = read_run(run)
    refuse_test_robots({run: facts})
    records = one_condition(read_records(ledger_of(run)))
    if not records:
        raise InputError(f"{place} holds no trial yet; the same evaluate command resumes it")
    explained = [record for record in records if record.key.method == AGAINST and explained_cuts(record)]
    rows, uneven, readable = median_trials(records), uneven_matching(records), readable_inference(explained)
    learned = _Learned.of(facts, records[0].key.origin) if explained else None
    sharing = find_sharing(explained, _foods(facts), learned.model, learned.demonstrations) if learned else None
    drawn = [*(record for row in rows for record in row), uneven]
    configurations = {record.key: read_configurations(ledger_of(run), record.key) for record in drawn}
    inferred = [record.key for record in (readable, sharing.record if sharing else None) if record]
    traces = _reproduce(run, [*(key for key, stored in configurations.items() if not stored), *inferred])
    known = {key: stored or traces[key].configurations for key, stored in configurations.items()}
    figures: dict[str, Any] = {}
    if learned and sharing:
        figures["1-sharing.png"] = _sharing_figure(sharing, traces[sharing.record.key], learned)
    if learned and readable:
        figures["2-inference.png"] = _inference_figure(traces[readable.key], learned)
    figures["4-methods.png"] = draw_methods(
        [_results_of(row, known) for row in rows], f"Results of every method: {name}"
    )
    title = f"Matched pairs: {_describe(uneven)}, {uneven.key.method}"
    figures["5-matched.png"] = draw_matching(_results_of([uneven], known), title, PAIRS_PER_ROW)
    for file, figure in figures.items():
        write_sheet(figure, out / file)
    return [out / file for file in figures]


@dataclass(frozen=True, eq=False)
class _Learned:
    """The model of some trials, the trials it was trained on, and the typical fragment of every type."""

    model: Model
    demonstrations: Sequence[Demonstration]
    typical: Sequence[TypicalFragment]

    @staticmethod
    def of(facts: RunFacts, origin: str) -> "_Learned":
        place = facts.models[facts.model_of(origin)]
        model = load_model(local_folder(place))
        data = facts.data if facts.data_digest == model.provenance.data else None
        demonstrations = training_trials_of(model, place, data)
        return _Learned(model, demonstrations, typical_fragments(model, demonstrations))


def _foods(facts: RunFacts) -> Callable[[int], Sequence[str]]:
    source = DataSet.open(local_folder(facts.data), allow_missing=bool(facts.missing))
    return lambda trial: source.summary(trial).foods


def _describe(record: Record) -> str:
    return f"{record.key.setup}, trial {record.key.trial}, {record.key.goals} goal"


def _inference_figure(trace: TrialTrace, learned: _Learned) -> Any:
    """Fig. 2, for the second cut of a trial."""
    inference = inference_of(trace, 1, learned.model, learned.typical)
    cut = len(inference.now) - len(trace.start) + 1
    return draw_inference(inference, f"One inference: {_describe(trace.record)}, cut {cut}")


def _sharing_figure(sharing: Sharing, trace: TrialTrace, learned: _Learned) -> Any:
    """Fig. 1, for the first cut of a trial."""
    planned = tree_of(inference_of(trace, 0, learned.model, learned.typical))
    seen, subtitle = sharing.demonstration, f"{_describe(sharing.record)}, the best parse tree"
    before, after = (", ".join(foods) for foods in (seen.foods, sharing.foods))
    return draw_sharing(
        Side(f"seen: {before}", f"training trial {seen.trial}", sharing.seen, seen.start, seen.goal),
        Side(f"planned: {after}", subtitle, planned, trace.start, trace.goal),
        sharing.production,
        f"From cutting {before} to cutting {after}",
    )


def _reproduce(run: Path, keys: Sequence[TrialKey]) -> dict[TrialKey, TrialTrace]:
    if not keys:
        return {}
    worker, jobs = worker_for(run, list(dict.fromkeys(keys)))
    traces = {}
    with progress("draw", len(jobs), 0) as advance:
        for i in range(len(jobs)):
            traces[jobs.keys[i]] = worker.carry_out(jobs[i])
            advance()
    return traces


def _results_of(records: Sequence[Record], known: dict[TrialKey, TrialConfigurations]) -> TrialResults:
    """The results of the methods whose records of one trial these are."""
    key = records[0].key
    results = [
        MethodResult(
            method=record.key.method,
            fragments=known[record.key].reached,
            pairs=tuple((int(i), int(j), float(iou)) for i, j, iou in record.events[-1]["pairs"]),
            iou_strict=record.iou_strict,
            status=record.status,
        )
        for record in records
    ]
    return TrialResults(key.setup, f"trial {key.trial}", known[key].start, known[key].goal, tuple(results))
