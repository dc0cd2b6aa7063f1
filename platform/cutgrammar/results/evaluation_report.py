"""The report of one or more evaluations, from the rows of their ledgers."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from cutgrammar.events import DECIDING_SCORE
from cutgrammar.methods.registry import describe_methods
from cutgrammar.results.comparisons import AGAINST, Condition, condition_of
from cutgrammar.results.report import Report, Section
from cutgrammar.results.score_report import NOT_INSTALLED, SEES_DEMONSTRATION, ConditionNumbers, condition_section
from cutgrammar.results.score_table import Row, by_trial, table_of
from cutgrammar.trials.scores import Score, describe_scores

TITLE = "Cutting objects into fragments: scores"
LEAD = (
    "How well each method cuts objects into the fragments of a goal, in the setups of Table I (N objects, M fragment "
    "categories). The data are ours, not the paper's: the numbers do not compare one to one with its Table I."
)
TERMS = (
    ("mean of setups, of trials", "Every setup counts once, as in the paper's table; every test trial counts once."),
    (
        "±",
        "Standard deviation of the mean over the runs, which are seeds of planning and execution with one trained "
        "model. A single run has none.",
    ),
    (
        "n",
        "Number of test trials, each averaged over its runs. Trials that failed or got stuck count with what they "
        "reached; none is left out.",
    ),
    (
        "95 % interval",
        "Bootstrap over trials, resampled within their setup; unknown where a setup has a single trial.",
    ),
    (
        "p",
        "Paired permutation test over trials. Holm: corrected for the methods and setups compared; the "
        "comparisons over all setups are a family of their own.",
    ),
    (
        f"P({AGAINST} above)",
        f"Probability that a run of {AGAINST} scores above a run of the method on the same trial, averaged over "
        "trials; a tie counts half.",
    ),
)
MARKED = (
    (
        SEES_DEMONSTRATION,
        "The method sees the trial's own demonstration. It shows what can be reached, and does not compete.",
    ),
    (
        NOT_INSTALLED,
        "The method is not installed here, so it is unknown whether it sees the demonstration. It does not compete.",
    ),
)


def evaluation_report(
    rows: Sequence[Row], timing: bool = True, notes: Sequence[str] = (), details: Sequence[Section] = ()
) -> Report:
    """The report of these rows.

    Args:
        rows: of ledgers, each trial once, in any order.
        timing: give times too; all else is reproduced exactly by the same seeds.
        notes: what a reader must know of the rows.
        details: further sections.
    """
    numbers = table_of(rows, timing)
    marks = _marks(row["method"] for row in numbers["rows"])
    scores = _scores(numbers["rows"])
    differences = _differences(rows)
    sections = [
        condition_section(condition, _of_condition(numbers, condition, marks, scores, differences.get(condition, {})))
        for condition in dict.fromkeys(map(condition_of, numbers["rows"]))
    ]
    glossary = [(score.label, score.help + ("" if score.higher_is_better else " Lower is better.")) for score in scores]
    glossary += [*TERMS, *((mark.strip(), said) for mark, said in MARKED if mark in marks.values())]
    return Report(
        TITLE,
        LEAD,
        numbers,
        (*sections, *details) if sections else (),
        tuple(glossary),
        (*notes, *_partly_known(rows)),
        numbers["digest"],
        tuple(dict.fromkeys(row["method"] for row in numbers["rows"])),
        frozenset(marks),
    )


def _of_condition(
    numbers: Mapping[str, Any],
    condition: Condition,
    marks: Mapping[str, str],
    scores: Sequence[Score],
    differences: Mapping[str, Mapping[str, tuple[float, ...]]],
) -> ConditionNumbers:
    rows, means, tests, improvement, profiles = (
        [entry for entry in numbers[name] if condition_of(entry) == condition]
        for name in ("rows", "setup_means", "tests", "improvement", "profiles")
    )
    paper = numbers["paper"]
    return ConditionNumbers(rows, means, tests, improvement, profiles, paper, marks, scores, differences)


def _marks(methods: Iterable[str]) -> dict[str, str]:
    """The methods that do not compete, each with its mark."""
    return {
        method.name: SEES_DEMONSTRATION if method.sees_demonstration else NOT_INSTALLED
        for method in describe_methods(methods)
        if not method.is_competitor
    }


def _scores(rows: Sequence[Mapping[str, Any]]) -> list[Score]:
    """The scores of which a value is known, the deciding one first."""
    fields = {name.removesuffix("_mean") for row in rows for name, value in row.items() if value is not None}
    found = [score for score in describe_scores(fields & _score_names(rows)) if score.name in fields]
    return sorted(found, key=lambda score: score.name != DECIDING_SCORE)


def _score_names(rows: Sequence[Mapping[str, Any]]) -> set[str]:
    return {name.removesuffix("_std_runs") for row in rows for name in row if name.endswith("_std_runs")}


def _differences(rows: Sequence[Row]) -> dict[Condition, dict[str, dict[str, tuple[float, ...]]]]:
    """Condition -> method -> setup -> deciding score of its trials minus that of the reference method."""
    scores = by_trial(rows)
    result: dict[Condition, dict[str, dict[str, tuple[float, ...]]]] = {}
    for (condition, method), found in scores.items():
        reference = scores.get((condition, AGAINST), {})
        shared = [unit for unit in found if unit in reference]
        if method == AGAINST or not shared:
            continue
        by_setup: dict[str, list[float]] = {}
        for unit in shared:
            by_setup.setdefault(unit[0], []).append(found[unit] - reference[unit])
        result.setdefault(condition, {})[method] = {setup: tuple(values) for setup, values in by_setup.items()}
    return result


def _partly_known(rows: Sequence[Row]) -> list[str]:
    """A note on each score that only some of the records have, e.g. since it was installed later."""
    names = sorted({name for row in rows for name in row.record.scores})
    present = {name: sum(name in row.record.scores for row in rows) for name in names}
    return [
        f"score {name} was computed for {count} of {len(rows)} rows only; its means are over these"
        for name, count in present.items()
        if count < len(rows)
    ]
