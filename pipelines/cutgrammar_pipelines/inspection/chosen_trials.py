"""Rules that choose the trials of a run to be drawn, so that nobody chooses them by eye."""

from collections.abc import Mapping, Sequence
from typing import Any

from cutgrammar.results.comparisons import AGAINST
from cutgrammar.trials.goals import GOALS
from cutgrammar.trials.record import UNFINISHED, Record
from cutgrammar.trials.setups import SETUPS

READABLE_GOALS = range(5, 10)
"""Numbers of goal fragments for which an inference is easy to read."""
PAIRS_PER_ROW = 9
"""Number of matched pairs that fit in a row."""


def one_condition(records: Sequence[Record]) -> list[Record]:
    """The records of the first goal condition, world, perception and run, except unfinished trials."""
    known = sorted((r for r in records if r.status not in UNFINISHED), key=lambda r: (r.key.goals != GOALS[0], r.key))
    names = ("goals", "world", "perception", "run")
    return [r for r in known if all(getattr(r.key, name) == getattr(known[0].key, name) for name in names)]


def median_trials(records: Sequence[Record]) -> list[list[Record]]:
    """All methods' records of one trial of each setup, in which the first method has its median strict IoU."""
    rows = []
    for setup in SETUPS:
        of_setup = [record for record in records if record.key.setup == setup]
        methods = in_order({record.key.method for record in of_setup})
        if not methods:
            continue
        trial = _median([record for record in of_setup if record.key.method == methods[0]]).key.trial
        by_method = {record.key.method: record for record in of_setup if record.key.trial == trial}
        rows.append([by_method[method] for method in methods if method in by_method])
    return rows


def readable_inference(explained: Sequence[Record]) -> Record | None:
    """The record whose inference is drawn, preferably of a goal that is easy to read; None if there are no records."""
    several_cuts = [record for record in explained if len(explained_cuts(record)) > 1] or explained
    easy = [r for r in several_cuts if r.goal_fragments in READABLE_GOALS and r.status == "done"]
    several_objects = [record for record in easy if record.key.setup != "N1M1"]
    return _median(several_objects or easy or several_cuts) if explained else None


def uneven_matching(records: Sequence[Record]) -> Record:
    """The record whose matching is drawn, preferably one with unmatched fragments, of the first method that has one.

    Among several, its number of goal fragments is the nearest to the number of pairs in a row.
    """
    uneven = [record for record in records if record.fragments not in (None, record.goal_fragments)] or records
    method = in_order({record.key.method for record in uneven})[0]
    candidates = [record for record in uneven if record.key.method == method]
    return min(candidates, key=lambda record: (abs(record.goal_fragments - PAIRS_PER_ROW), record.key))


def explained_cuts(record: Record) -> list[Mapping[str, Any]]:
    """The events of cuts that were explained by a production."""
    return [event for event in record.events if event.get("production")]


def in_order(methods: set[str]) -> list[str]:
    """The method with which others are compared, then the others by name."""
    return sorted(methods, key=lambda method: (method != AGAINST, method))


def _median(records: Sequence[Record]) -> Record:
    """The record with the median strict IoU, the lower of two."""
    return sorted(records, key=lambda record: (record.iou_strict, record.key))[(len(records) - 1) // 2]
