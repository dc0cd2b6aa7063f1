"""The report of one or more evaluations, from the rows of their ledgers."""

from collections import Counter
from collections.abc import Callable, Sequence

from cutgrammar.results.human_rating import human_ratings
from cutgrammar.results.numbers import BY_PEOPLE, NOT_INSTALLED, SEES_DEMONSTRATION
from cutgrammar.results.rating_report import TERMS, rating_notes, ratings_section, with_ratings
from cutgrammar.results.report import Report, Section
from cutgrammar.results.score_report import condition_section
from cutgrammar.results.score_table import Row, ignore, numbers_of
from cutgrammar.results.statistics import MAX_RESAMPLED
from cutgrammar.storage.ratings import Rating

TITLE = "Cutting objects into fragments: scores"
LEAD = (
    "How well each method cuts objects into the fragments of a goal, in the setups of Table I (N objects, M fragment "
    "categories). The data are ours, not the paper's: the numbers do not compare one to one with its Table I."
)
MEANS = ("mean of setups, of trials", "Every setup counts once, as in the paper's table; every test trial counts once.")
RUNS = {
    False: (
        (
            "±",
            "Standard deviation of the mean over the runs, which are seeds of planning and execution with one trained "
            "model. A single run has none.",
        ),
        ("worst run", "The lowest mean of a run."),
        (
            "95 % interval",
            "Bootstrap over trials, resampled within their setup; Student's t where there are more than "
            f"{MAX_RESAMPLED} trials. Unknown where a setup has a single trial.",
        ),
        (
            "p",
            "Paired permutation test over trials, for this one trained model; paired t test where there are more than "
            f"{MAX_RESAMPLED} trials. Holm: corrected for the methods and setups compared with one reference method; "
            "the comparisons over all setups are a family of their own.",
        ),
    ),
    True: (
        (
            "±",
            "Standard deviation of the mean over the runs, which are models trained with different seeds. A single "
            "run, as of a method that no model and no seed changes, has none.",
        ),
        ("worst model", "The lowest mean of a model."),
        (
            "95 % interval",
            "Student's t, with trials (within their setup) and models both taken as random; unknown where a setup has "
            "a single trial.",
        ),
        (
            "p",
            "Paired t test over trials and models, both taken as random; two methods that no model changes are "
            f"compared over trials alone, by a permutation test up to {MAX_RESAMPLED} of them. Holm: corrected for the "
            "methods and setups compared with one reference method; the comparisons over all setups are a family of "
            "their own.",
        ),
    ),
}
"""What tables say of runs: whether they are models -> (term, explanation), ..."""
N = (
    "n",
    "Number of test trials, each averaged over its runs. Trials that failed or got stuck count with what they reached; "
    "none is left out.",
)
MARKED = (
    (
        SEES_DEMONSTRATION,
        "The method sees a demonstration: the trial's own, or those that a foreign goal is from. It does not compete.",
    ),
    (
        NOT_INSTALLED,
        "The method is not installed here, so it is unknown whether it sees the demonstration. It does not compete.",
    ),
    (
        BY_PEOPLE,
        "People were shown the goal and cut by hand: the upper bound, which does not compete. Only goals that somebody "
        "reproduced count (n); a goal that several people reproduced counts once, with their mean. Its means are over "
        "other trials than those of methods with another n; differences and tests take the trials that both have.",
    ),
)


def evaluation_report(
    rows: Sequence[Row],
    timing: bool = True,
    notes: Sequence[str] = (),
    details: Sequence[Section] = (),
    against: Sequence[str] | None = None,
    ratings: Sequence[Rating] = (),
    watch: Callable[[int, int], object] = ignore,
) -> Report:
    """The report of these rows.

    Args:
        rows: of ledgers, each trial once, in any order.
        timing: give times too; all else is reproduced exactly by the same seeds.
        notes: what a reader must know of the rows.
        details: further sections.
        against: the methods that the others are tested against (see `numbers_of`).
        ratings: people's answers about these rows, if there are any.
        watch: see `numbers_of`.
    """
    numbers = numbers_of(rows, timing, against, watch)
    sections = [condition_section(condition) for condition in numbers.conditions]
    rated = {rating.trial for rating in ratings}
    trials = {
        row.record.key.digest: (row.condition, row.record.key.method, row.unit)
        for row in rows
        if rated and row.record.key.digest in rated  # digests take seconds where there are many rows
    }
    human = human_ratings(ratings, trials)
    if human is not None:
        numbers = with_ratings(numbers, human)
        sections.append(ratings_section(human, numbers))
        notes = (*notes, *rating_notes(human))
    glossary = [
        (score.label, score.help + ("" if score.higher_is_better else " Lower is better.")) for score in numbers.scores
    ]
    glossary += [MEANS, N, *RUNS[numbers.runs_are_models]]
    glossary += [
        (
            f"P({name} above)",
            f"Probability that a run of {name} scores above a run of the method on the same trial"
            f"{', with the same model' * numbers.runs_are_models}, averaged over trials; a tie counts half.",
        )
        for name in dict.fromkeys(name for condition in numbers.conditions for name in condition.references)
    ]
    glossary += TERMS if human is not None else ()
    glossary += [*((mark.strip(), meaning) for mark, meaning in MARKED if mark in numbers.marks.values())]
    return Report(
        TITLE,
        LEAD,
        numbers.to_json() | ({"human_rating": human.to_json()} if human is not None else {}),
        (*sections, *details) if sections else (),
        tuple(glossary),
        (*notes, *_partly_known(rows)),
        numbers.digest,
        tuple(method.name for method in numbers.methods),
        frozenset(numbers.marks),
    )


def _partly_known(rows: Sequence[Row]) -> list[str]:
    """A note on each score that only some of the records have, e.g. since it was installed later."""
    counts = Counter(name for row in rows for name in row.record.scores)
    return [
        f"score {name} was computed for {count} of {len(rows)} rows only; its means are over these"
        for name, count in sorted(counts.items())
        if count < len(rows)
    ]
