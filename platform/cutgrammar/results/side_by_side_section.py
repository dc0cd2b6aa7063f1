"""The section of a report about two runs side by side: tables and charts of their differences."""

from collections.abc import Sequence

from cutgrammar.events import DECIDING_SCORE
from cutgrammar.results.comparisons import ALL, Condition
from cutgrammar.results.numbers import Entry
from cutgrammar.results.report import (
    Cell,
    Column,
    Dot,
    DotChart,
    Item,
    Panel,
    Row,
    Section,
    StripChart,
    Table,
    as_interval,
    columns,
    keys,
)
from cutgrammar.results.side_by_side import SideBySide

FOLD_SETUPS, FOLD_SCORES, FOLD_TRIALS = "Setup by setup", "The other scores", "Trial by trial"


def side_by_side_section(runs: SideBySide) -> Section:
    """Both runs with their differences, over all setups, in each, and trial by trial."""
    items: list[Item] = []
    for conditions in runs.conditions:
        entries = [entry for entry in runs.entries if _is_of(entry, conditions)]
        deciding = [entry for entry in entries if entry["score"] == DECIDING_SCORE]
        others = [entry for entry in entries if entry["score"] != DECIDING_SCORE and entry["setup"] == ALL]
        overall = [entry for entry in deciding if entry["setup"] == ALL]
        if not overall:
            continue
        name = f"goals {conditions[0][0]}, {_named(conditions)}"
        label = runs.scores[0].label
        items += [
            _table(runs, overall, f"{label}, over all setups: {name}", keys("method"), ("method",)),
            _chart(runs, overall, name),
        ]
        single = [entry for entry in deciding if entry["setup"] != ALL]
        heads = keys("setup", "method")
        items.append(_table(runs, single, f"{label} in each setup: {name}", heads, ("setup", "method"), FOLD_SETUPS))
        if others:
            labels = {score.name: score.label for score in runs.scores}
            named = [{**entry, "score": labels[entry["score"]]} for entry in others]
            heads = keys("score", "method")
            items.append(_table(runs, named, f"Over all setups: {name}", heads, ("score", "method"), FOLD_SCORES))
        items.append(
            StripChart(
                f"Differences between the runs in {label}, trial by trial: {name}",
                f"Each dot is a test trial averaged over its runs; the bar is the mean of a method; {name}.",
                f"{label} of {runs.second.name} minus that of {runs.first.name}",
                {
                    method: {setup: tuple(values) for setup, values in by_setup.items()}
                    for method, by_setup in runs.differences(conditions).items()
                },
                FOLD_TRIALS,
            )
        )
    random = "trials and models" if runs.runs_are_models else "trials"
    lead = (
        f"What {runs.first.name} and {runs.second.name} score on the trials that both have, and the second minus the "
        f"first, trial by trial; intervals and tests take {random} as random. All sections after these are about "
        f"{runs.first.name} alone."
    )
    return Section(f"{runs.second.name} beside {runs.first.name}", tuple(items), lead=lead)


def _table(
    runs: SideBySide,
    entries: Sequence[Entry],
    title: str,
    heads: Sequence[Column],
    names: Sequence[str],
    fold: str = "",
) -> Table:
    has_tests = any("p_value" in entry for entry in entries)
    rows = []
    for entry in entries:
        cells = [*(Cell(entry[name]) for name in names), Cell(entry["trials"])]
        cells += [
            Cell(entry[f"{side}_mean"], ".3f", interval=as_interval(entry[f"{side}_ci95"]))
            for side in ("first", "second")
        ]
        cells += [Cell(entry["mean_difference"], "+.3f"), Cell(as_interval(entry["ci95"]), "+.3f")]
        cells += [Cell(entry["p_value"], "p"), Cell(entry["p_corrected"], "p")] if has_tests else []
        rows.append(Row(tuple(cells)))
    return Table(
        title,
        (
            *heads,
            *columns("n", runs.first.name, runs.second.name, "difference", "95 % interval"),
            *columns(*["p", "p (Holm)"] * has_tests),
        ),
        tuple(rows),
        "Means over the trials that both runs have; every trial counts once.",
        fold,
    )


def _chart(runs: SideBySide, entries: Sequence[Entry], name: str) -> DotChart:
    dots = tuple(
        Dot(entry["method"], entry["method"], entry["mean_difference"], as_interval(entry["ci95"])) for entry in entries
    )
    label = f"{runs.scores[0].label} of {runs.second.name} minus that of {runs.first.name}"
    return DotChart(
        f"{label}, with 95 % intervals: {name}",
        f"Mean difference over all trials and its 95 % interval; right of the line {runs.second.name} is better.",
        tuple(entry["method"] for entry in entries),
        (Panel("", dots, 0.0),),
        label,
        None,
    )


def _is_of(entry: Entry, conditions: tuple[Condition, Condition]) -> bool:
    second = entry.get("second_condition", entry)
    return all(
        tuple(fields[name] for name in ("goals", "world", "perception")) == condition
        for fields, condition in ((entry, conditions[0]), (second, conditions[1]))
    )


def _named(conditions: tuple[Condition, Condition]) -> str:
    """World and perception, of both runs where they differ."""
    names = [f"world {world}, perception {perception}" for _, world, perception in conditions]
    return names[0] if names[0] == names[1] else f"{names[0]} beside {names[1]}"
