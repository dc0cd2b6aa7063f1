"""Rows of a report made by hand."""

from dataclasses import replace

from cutgrammar.results.score_table import Row
from cutgrammar.trials.record import TrialKey


def row(made, setup="N1M1", trial=0, method="grammar", run=0, strict=0.5, goals="in-place", data="d", **changes):
    key = TrialKey(setup, trial, goals, method, run, "bench", "truth", changes.pop("origin", "o"))
    scores = {"iou": strict, "iou_strict": strict} | changes.pop("scores", {})
    return Row(replace(made.record_for(key, strict), scores=scores, **changes), data)


def only(report, **wanted):
    (found,) = [r for r in report["rows"] if all(r[k] == v for k, v in wanted.items())]
    return found


def scored_event(pairs):
    """A `Scored` as a record holds it, with these pairs."""
    event = {"event": "Scored", "scores": {}, "fragments": 9, "goal_fragments": 9, "reason": None}
    return event | {"pairs": [list(pair) for pair in pairs]}
