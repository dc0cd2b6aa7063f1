"""The trials of runs as CSV, one line each, for other programs and one's own statistics."""

import csv
import io
from collections.abc import Iterable

from cutgrammar.results.score_table import Row
from cutgrammar.trials.scores import describe_scores

KEY = ("setup", "trial", "goals", "method", "run", "world", "perception")
OUTCOME = ("status", "goal_fragments", "fragments", "cuts", "refusals", "dead_ends")
TIMES = ("planning_seconds", "seconds")


def as_csv(rows: Iterable[Row], timing: bool = True) -> str:
    """A header and one line for each row, in the order of keys, data sets and models; empty where a value is not known.

    Args:
        rows: each trial once, in any order.
        timing: give the times, too [s].
    """
    rows = sorted(rows, key=lambda row: (row.record.key, row.data, row.model))
    scores = [score.name for score in describe_scores(name for row in rows for name in row.record.scores)]
    times = TIMES if timing else ()
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow([*KEY, *OUTCOME, *scores, *times, "data", "model"])
    for row in rows:
        record = row.record
        lines.writerow(
            [
                *(getattr(record.key, name) for name in KEY),
                *(getattr(record, name) for name in OUTCOME),
                *(record.scores.get(name) for name in scores),
                *(getattr(record, name) for name in times),
                row.data,
                row.model,
            ]
        )
    return text.getvalue()
