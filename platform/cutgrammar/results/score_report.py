"""The report of an evaluation: the tables and charts that follow from its numbers."""

from collections.abc import Iterable, Mapping, Sequence

from cutgrammar.events import DECIDING_SCORE
from cutgrammar.results.comparisons import AGAINST, ALL
from cutgrammar.results.numbers import ConditionNumbers, Entry
from cutgrammar.results.paper_table import COLUMNS, PRINTED
from cutgrammar.results.report import (
    Cell,
    Column,
    Dot,
    DotChart,
    Item,
    Line,
    LineChart,
    Panel,
    Row,
    RowKind,
    Section,
    StripChart,
    Table,
    as_interval,
    columns,
    keys,
    words,
)
from cutgrammar.trials.scores import Score

GOAL_NOTES = {
    "foreign": "; each goal is what another individual, of the same food where possible, was cut into, scaled to the "
    "volume at hand",
    "foreign-food": "; each goal is what an individual of another food was cut into, scaled to the volume at hand",
}
"""What is said of a goal condition below the heading of its section."""
IN_PLACE = "in-place"
"""The paper's goals: where they were cut."""
FOLD_TESTS, FOLD_TRIALS = "Setup by setup, minus {}", "Trial by trial, minus {}"
FOLD_SCORES, FOLD_OUTCOMES = "The other scores, setup by setup", "How the trials went"


def condition_section(numbers: ConditionNumbers) -> Section:
    """All tables and charts of one condition."""
    goals, world, perception = numbers.condition
    items: list[Item] = [_overview(numbers), _score_chart(numbers), _by_setup(numbers, numbers.scores[0])]
    if goals == IN_PLACE:
        items += _beside_the_paper(numbers)
    items += [table for name in numbers.references for table in _against_reference(numbers, name, overall=True)]
    items.append(_profiles(numbers))
    for name in numbers.references:
        items += [*_against_reference(numbers, name, overall=False), *_differences(numbers, name)]
    items += [_by_setup(numbers, score, FOLD_SCORES) for score in numbers.scores[1:]]
    items.append(_outcomes(numbers))
    return Section(f"Goals {goals}", tuple(items), f"world {world}, perception {perception}{GOAL_NOTES.get(goals, '')}")


def _overview(numbers: ConditionNumbers) -> Table:
    """Every method in one row: its scores over all setups and how its trials ended."""
    means, cells = numbers.means, numbers.cells
    deciding, *others = numbers.scores
    rows = []
    for method in numbers.methods:
        overall, mean = cells[ALL, method], means[method]
        row = [_name(numbers, method), Cell(overall["trials"]), Cell(overall["runs"])]
        row += [_score(mean, deciding), _worst(mean), _score(overall, deciding)]
        row += [Cell(mean[f"{score.name}_mean"], ".3f") for score in others]
        row += [Cell(overall["cuts_mean"], ".1f")]
        row += [Cell(overall[name]) for name in ("failures", "stuck", "dead_ends")]
        row += [Cell(overall["seconds_mean"], ".1f")] if numbers.is_timed else []
        rows.append(Row(tuple(row), _kind(numbers, method)))
    return Table(
        "Over all setups",
        (
            *keys("method"),
            *columns("n", f"{_run_word(numbers)}s"),
            *(
                Column(heading, deciding.label)
                for heading in ("mean of setups", f"worst {_run_word(numbers)}", "mean of trials")
            ),
            *columns(*map(_heading, others), "cuts", "failed", "stuck", "dead ends", *["seconds"] * numbers.is_timed),
        ),
        tuple(rows),
        f"Other scores: mean of setups{_arrow_note(others)}. Cuts{' and seconds' * numbers.is_timed}: mean of a trial. "
        "Failed and stuck: runs; dead ends: cuts planned from one.",
    )


def _by_setup(numbers: ConditionNumbers, score: Score, fold: str = "") -> Table:
    """Methods down, setups across; the means over setups and over trials at the end."""
    cells, means = numbers.cells, numbers.means
    rows = []
    for method in numbers.methods:
        row = [_name(numbers, method), *(_score(cells.get((setup, method)), score) for setup in numbers.setups)]
        row += [_score(means[method], score)]
        row += [_worst(means[method])] if score.name == DECIDING_SCORE else []
        row += [_score(cells[ALL, method], score)]
        rows.append(Row(tuple(row), _kind(numbers, method)))
    worst = [f"worst {_run_word(numbers)}"] if score.name == DECIDING_SCORE else []
    trials = {setup: max(row["trials"] for row in numbers.rows if row["setup"] == setup) for setup in numbers.setups}
    return Table(
        f"{_capital(_heading(score))} in each setup",
        (
            *keys("method"),
            *(Column(setup, f"n = {trials[setup]}") for setup in numbers.setups),
            *columns("mean of setups", *worst, "mean of trials"),
        ),
        tuple(rows),
        _fewer_trials(numbers, trials),
        fold,
    )


def _fewer_trials(numbers: ConditionNumbers, trials: Mapping[str, int]) -> str:
    """Which methods have fewer trials than the heads of the columns say, and how many; nothing if none has."""
    found = []
    for method in numbers.methods:
        own = {setup: numbers.cells.get((setup, method), {"trials": 0})["trials"] for setup in numbers.setups}
        if any(own[setup] < trials[setup] for setup in own):
            counts = ", ".join(f"{own[setup]} of {trials[setup]} in {setup}" for setup in own)
            found.append(f"{method + numbers.marks.get(method, '')} has {counts}")
    return f"Fewer trials than n: {'; '.join(found)}." if found else ""


def _beside_the_paper(numbers: ConditionNumbers) -> list[Item]:
    """Setups down; for each evaluated method of the paper the scores reached and the IoU that the paper prints."""
    evaluated = [(column, method) for column, method in enumerate(COLUMNS) if method in numbers.methods]
    if not evaluated:
        return []
    reached = numbers.cells | {(ALL, method): entry for method, entry in numbers.means.items()}
    heads, rows = [*keys("setup")], []
    for _, method in evaluated:
        group = f"{AGAINST} (paper: Ours)" if method == AGAINST else method + numbers.marks.get(method, "")
        heads += [Column(name, group) for name in ("strict", "matched", "paper")]
    for setup in (*numbers.setups, ALL):
        row = [Cell("mean of setups" if setup == ALL else setup)]
        for column, method in evaluated:
            entry = reached.get((setup, method), {})
            row += [
                Cell(entry.get(f"{name}_mean"), ".3f", entry.get(f"{name}_std_runs"))
                for name in (DECIDING_SCORE, "iou")
            ]
            if setup == ALL:
                row.append(Cell(_printed_mean(numbers.setups, column), ".2f"))
            else:
                mean, spread = PRINTED[setup][column] if setup in PRINTED else (None, None)
                row.append(Cell(mean, ".2f", spread))
        rows.append(Row(tuple(row), "total" if setup == ALL else ""))
    note = "The paper's numbers are from other foods, demonstrations and meshes: they do not compare one to one."
    title = "Table I: best-matched IoU here and as the paper prints it"
    return [Table(title, tuple(heads), tuple(rows), note)]


def _against_reference(numbers: ConditionNumbers, against: str, overall: bool) -> list[Item]:
    """Every method against a reference method, over all setups or in each: difference, test, probability of wins."""
    wins = {(entry["setup"], entry["over"]): entry for entry in numbers.improvement if entry["method"] == against}
    rows = []
    for test in numbers.tests:
        if (test["setup"] == ALL) != overall or test["against"] != against:
            continue
        name, win = _name(numbers, test["method"]), wins[test["setup"], test["method"]]
        cells = (
            *((name, Cell(test["trials"])) if overall else (Cell(test["setup"]), name)),
            Cell(test["mean_difference"], "+.3f"),
            Cell(as_interval(test["ci95"]), "+.3f"),
            Cell(test["p_value"], "p"),
            Cell(test["p_corrected"], "p"),
            Cell(win["probability"], ".3f"),
            Cell(as_interval(win["ci95"]), ".3f"),
        )
        rows.append(Row(cells, _kind(numbers, test["method"]) if overall else ""))
    title = f"{_capital(numbers.label)} minus that of {against}"
    title += ", trial by trial, over all setups" if overall else " in each setup"
    heads = (
        *((*keys("method"), *columns("n")) if overall else keys("setup", "method")),
        *columns("difference", "95 % interval", "p", "p (Holm)", f"P({against} above)", "95 % interval"),
    )
    return [Table(title, heads, tuple(rows), fold="" if overall else FOLD_TESTS.format(against))] if rows else []


def _differences(numbers: ConditionNumbers, against: str) -> list[Item]:
    """Every method's difference from a reference method in each trial that both have, by setup."""
    trials = numbers.trials
    differences: dict[str, dict[str, list[float]]] = {}
    for method, scores in trials.items():
        for unit, score in scores.items():
            if method != against and unit in (reference := trials.get(against, {})):
                differences.setdefault(method, {}).setdefault(unit[0], []).append(score - reference[unit])
    chart = StripChart(
        f"Differences in {numbers.label} from {against}, trial by trial",
        "Each dot is a test trial averaged over its runs; the bar is the mean of a method.",
        f"{numbers.label} minus that of {against} (left: {against} is better)",
        {
            method: {setup: tuple(values) for setup, values in by_setup.items()}
            for method, by_setup in differences.items()
        },
        FOLD_TRIALS.format(against),
    )
    return [chart] if differences else []


def _outcomes(numbers: ConditionNumbers) -> Table:
    """How the trials went, setup by setup."""
    rows = []
    for entry in numbers.rows:
        row = [Cell(entry["setup"]), _name(numbers, entry["method"]), Cell(entry["cuts_mean"], ".1f")]
        row += [Cell(entry[name]) for name in ("failures", "stuck", "dead_ends")]
        row += [Cell(entry["seconds_mean"], ".2f")] if numbers.is_timed else []
        rows.append(Row((*row, Cell(entry["digest"][:8], is_code=True))))
    return Table(
        "Cuts, endings and time of the trials in each setup",
        (
            *keys("setup", "method"),
            *columns("cuts a trial", "failed", "stuck", "dead ends", *["seconds a trial"] * numbers.is_timed),
            *words("digest"),
        ),
        tuple(rows),
        "Failed and stuck: runs of trials; dead ends: cuts planned from one; digest: of all but times.",
        FOLD_OUTCOMES,
    )


def _score_chart(numbers: ConditionNumbers) -> DotChart:
    """Deciding score with its interval: a panel for each setup, a line for each method."""
    panels, reference = [], next(iter(numbers.references), None)
    for setup in (*numbers.setups, ALL):
        entries = {row["method"]: row for row in numbers.rows if row["setup"] == setup}
        mean, ends = f"{DECIDING_SCORE}_mean", f"{DECIDING_SCORE}_ci95"
        dots = tuple(Dot(name, name, row[mean], as_interval(row[ends])) for name, row in entries.items())
        panels.append(Panel(setup, dots, entries[reference][mean] if reference in entries else None))
    return DotChart(
        f"Mean {numbers.label} by setup and method with 95 % intervals",
        f"Mean {numbers.label} and its 95 % interval"
        + (f"; the upright line is {reference}." if reference is not None else "."),
        tuple(numbers.methods),
        tuple(panels),
    )


def _profiles(numbers: ConditionNumbers) -> tuple[LineChart | DotChart, ...]:
    """Performance profiles and, beside them, the probability that each reference method is better."""
    label = numbers.label
    is_dashed = any(method in numbers.marks for method in numbers.methods)
    profiles = LineChart(
        f"Share of runs above every {label}, method by method",
        f"The share of runs whose {label} is above a threshold, with 95 % bands"
        + ("; dashed: methods that do not compete." if is_dashed else "."),
        tuple(
            Line(entry["method"], tuple(entry["thresholds"]), tuple(entry["share"]), _band(entry["ci95"]))
            for entry in numbers.profiles
        ),
        label,
        "share of runs above it",
    )
    wins = [entry for entry in numbers.improvement if entry["setup"] == ALL and entry["probability"] is not None]
    return profiles, *(
        _wins([entry for entry in wins if entry["method"] == name], name)
        for name in numbers.references
        if any(entry["method"] == name for entry in wins)
    )


def _wins(wins: Sequence[Entry], against: str) -> DotChart:
    """The probability that a reference method is better than each other method."""
    dots = tuple(Dot(entry["over"], entry["over"], entry["probability"], as_interval(entry["ci95"])) for entry in wins)
    return DotChart(
        f"Probability that {against} scores above each other method",
        f"Probability that a run of {against} scores above a run of the method on the same trial.",
        tuple(entry["over"] for entry in wins),
        (Panel("", dots, 0.5),),
        f"P({against} scores above it)",
        is_narrow=True,
    )


def _band(ends: Sequence[Sequence[float]] | None) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    return None if ends is None else (tuple(ends[0]), tuple(ends[1]))


def _name(numbers: ConditionNumbers, method: str) -> Cell:
    """The method with its mark."""
    return Cell(method + numbers.marks.get(method, ""))


def _kind(numbers: ConditionNumbers, method: str) -> RowKind:
    """The first method that does not compete is set apart from those above it."""
    first = next((name for name in numbers.methods if name in numbers.marks), None)
    return "apart" if method == first and method != numbers.methods[0] else ""


def _score(entry: Entry | None, score: Score) -> Cell:
    """The mean of a score with its spread over runs and its interval, where they are known."""
    if entry is None:
        return Cell(None)
    mean, ends = entry[f"{score.name}_mean"], as_interval(entry.get(f"{score.name}_ci95"))
    return Cell(mean, ".3f", entry.get(f"{score.name}_std_runs"), ends)


def _worst(entry: Entry) -> Cell:
    """The lowest mean of a run; unknown where there is a single one."""
    return Cell(entry[f"{DECIDING_SCORE}_worst_run"], ".3f")


def _run_word(numbers: ConditionNumbers) -> str:
    return "model" if numbers.runs_are_models else "run"


def _printed_mean(setups: Sequence[str], column: int) -> float | None:
    """The mean over setups of what the paper prints; None unless it prints all of them."""
    if not set(setups) <= set(PRINTED):
        return None
    return sum(PRINTED[setup][column][0] for setup in setups) / len(setups)


def _arrow_note(scores: Iterable[Score]) -> str:
    return "" if all(score.higher_is_better for score in scores) else "; \N{DOWNWARDS ARROW}: lower is better"


def _heading(score: Score) -> str:
    """The label of a score, with an arrow if lower is better."""
    return score.label if score.higher_is_better else f"{score.label} \N{DOWNWARDS ARROW}"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
