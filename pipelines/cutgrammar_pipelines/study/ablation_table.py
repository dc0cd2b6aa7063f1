"""The numbers of ablations, oracles and transfers: pure functions of ledgers' rows.

As in a report, the unit is the trial averaged over its runs. Comparisons are in strict IoU, paired trial by trial, on
the trials and runs that both sides have.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from operator import itemgetter
from typing import Any

import numpy as np

from cutgrammar.results.comparisons import AGAINST, ALL, condition_fields
from cutgrammar.results.samples import ANY_MODEL, Unit, paired_difference
from cutgrammar.results.score_table import Row, by_trial, table_of
from cutgrammar.results.statistics import holm
from cutgrammar.seeds import stream

ORACLES = ("grammar", "oracle-types", "oracle-parse", "oracle-planes")
"""Each oracle knows everything that those before it know."""


@dataclass(frozen=True, eq=False)
class Evaluated:
    """An evaluation of a variant, of a transfer, or of the study itself.

    Attributes:
        name: that of its run folder.
        question: that it answers.
        rows: of its ledger.
        facts: how it differs from others, e.g. "k"; plain data.
    """

    name: str
    question: str
    rows: tuple[Row, ...]
    facts: Mapping[str, Any]


def ablation_table(base: Evaluated, variants: Sequence[Evaluated]) -> dict[str, Any]:
    """`{"rows": [...], "training_seeds": [...]}`: every variant beside the study itself.

    The study's own row is repeated under every question, over the trials and runs of that question's variants. Holm's
    correction is for all variants of one method and condition.

    Args:
        base: the study's main evaluation.
        variants: in any order; those of one question are put together.
    """
    rows: list[dict[str, Any]] = []
    for question in dict.fromkeys(variant.question for variant in variants):
        chosen = [variant for variant in variants if variant.question == question]
        trials = {_trial(row) for variant in chosen for row in variant.rows}
        shared = [row for row in base.rows if _trial(row) in trials]
        rows += _rows(Evaluated("base", question, tuple(shared), base.facts), None)
        for variant in chosen:
            rows += _rows(variant, base.rows)
    family_of = itemgetter("method", "goals", "world", "perception")
    compared = sorted((row for row in rows if row["p_value"] is not None), key=family_of)
    for _, group in groupby(compared, family_of):
        family = list(group)
        for row, corrected in zip(family, holm([row["p_value"] for row in family]), strict=True):
            row["p_corrected"] = corrected
    return {"rows": rows, "training_seeds": _training_seeds(base, variants)}


def oracle_table(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """The gain of each oracle over the one before it, in each setup and over all, and the remainder to 1.

    Args:
        rows: of one evaluation; other methods than `ORACLES` are left out, and so are trials that an oracle lacks.

    Returns:
        One row for each setup and condition: the score of each of `ORACLES`, the gain of each but the first with its
        95 % interval and p-value, and the remainder; no rows if there are fewer than two oracles.
    """
    known = [row for row in rows if row.record.key.method in ORACLES]
    steps = [name for name in ORACLES if any(row.record.key.method == name for row in known)]
    if len(steps) < 2:
        return []
    shared = set.intersection(*({_trial(r)[:-1] for r in known if r.record.key.method == name} for name in steps))
    scores = by_trial(row for row in known if _trial(row)[:-1] in shared)
    table = []
    for condition in dict.fromkeys(condition for condition, _ in scores):
        units = sorted(scores[condition, steps[0]])
        for setup in (*dict.fromkeys(unit[0] for unit in units), ALL):
            chosen = [unit for unit in units if setup in (ALL, unit[0])]
            means = [float(np.mean([scores[condition, name][unit] for unit in chosen])) for name in steps]
            added = [
                {
                    "oracle": name,
                    **_difference(scores[condition, name], scores[condition, before], chosen, ("oracle", name, setup)),
                }
                for before, name in pairwise(steps)
            ]
            table.append(
                {
                    **condition_fields(condition),
                    "setup": setup,
                    "trials": len(chosen),
                    "scores": dict(zip(steps, means, strict=True)),
                    "adds": added,
                    "remainder": 1.0 - means[-1],
                }
            )
    return table


def transfer_table(evaluated: Sequence[Evaluated]) -> list[dict[str, Any]]:
    """One row for each transfer, food tested, condition and method, with the test against `AGAINST` on that food."""
    result = []
    for evaluation in evaluated:
        table = table_of(evaluation.rows)
        tests = {(t["goals"], t["method"]): t for t in table["tests"] if (t["setup"], t["against"]) == (ALL, AGAINST)}
        for row in table["rows"]:
            if row["setup"] != ALL:
                continue
            test = tests.get((row["goals"], row["method"]), {})
            result.append(
                {
                    "transfer": evaluation.question,
                    "name": evaluation.name,
                    **evaluation.facts,
                    **_numbers(row),
                    "against": AGAINST,
                    **{name: test.get(name) for name in ("mean_difference", "ci95", "p_value", "p_corrected")},
                }
            )
    return result


def _rows(evaluated: Evaluated, base: Sequence[Row] | None) -> list[dict[str, Any]]:
    """One row for each condition and method of `evaluated`, compared with the same trials and runs in `base`."""
    trials = {_trial(row) for row in evaluated.rows}
    scores, others = by_trial(evaluated.rows), by_trial(row for row in base or () if _trial(row) in trials)
    result = []
    for condition, method in scores:
        of_method = [row for row in evaluated.rows if (row.condition, row.record.key.method) == (condition, method)]
        summary = next(row for row in table_of(of_method)["rows"] if row["setup"] == ALL)
        reference = others.get((condition, method), {})
        units = sorted(set(scores[condition, method]) & set(reference))
        result.append(
            {
                "question": evaluated.question,
                "variant": evaluated.name,
                **evaluated.facts,
                "runs": len({row.record.key.run for row in of_method}),
                **_numbers(summary),
                **_difference(scores[condition, method], reference, units, ("ablation", evaluated.name, method)),
                "p_corrected": None,
            }
        )
    return result


def _difference(
    scores: Mapping[Unit, float], others: Mapping[Unit, float], units: Sequence[Unit], names: tuple[str, ...]
) -> dict[str, Any]:
    """Mean of `scores` minus `others` over `units`, with its interval and p-value; `names` name the random streams."""
    differences = {unit: {ANY_MODEL: scores[unit] - others[unit]} for unit in units}
    return paired_difference(
        differences, stream(0, "ablations", "interval", *names), stream(0, "ablations", "test", *names)
    )


def _training_seeds(base: Evaluated, variants: Sequence[Evaluated]) -> list[dict[str, Any]]:
    """The scores of models whose trainings differ only in the seed, and their spread."""
    same_training = itemgetter("changes", "training_trials")
    retrained = [
        variant
        for variant in variants
        if same_training(variant.facts) == same_training(base.facts)
        and variant.facts["training_seed"] != base.facts["training_seed"]
    ]
    if not retrained:
        return []
    shared = set.intersection(*({_trial(row) for row in variant.rows} for variant in retrained))
    scores = [by_trial(row for row in model.rows if _trial(row) in shared) for model in (base, *retrained)]
    result = []
    for condition, method in scores[0]:
        means = [float(np.mean(list(score[condition, method].values()))) for score in scores]
        result.append(
            {
                **condition_fields(condition),
                "method": method,
                "training_seeds": [model.facts["training_seed"] for model in (base, *retrained)],
                "iou_strict_means": means,
                "iou_strict_mean": float(np.mean(means)),
                "iou_strict_std_seeds": float(np.std(means, ddof=1)),
            }
        )
    return result


def _trial(row: Row) -> tuple[Any, ...]:
    """Condition, trial, run and method of a row."""
    return *row.condition, *row.unit, row.record.key.run, row.record.key.method


def _numbers(row: Mapping[str, Any]) -> dict[str, Any]:
    """The condition, method and numbers of a report's row."""
    return {name: value for name, value in row.items() if name not in ("setup", "digest")}
