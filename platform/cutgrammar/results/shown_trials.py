"""Which trials a page shows in three dimensions: the worst, median and best of each method, and those named."""

from collections.abc import Iterable, Sequence

from cutgrammar.results.comparisons import AGAINST
from cutgrammar.trials.goals import GOALS
from cutgrammar.trials.record import Record

MAX_TRIALS = 60
"""Number of trials that a page shows, without those that are named."""
NAMED, WORST, MEDIAN, BEST = "named", "worst", "median", "best"
ORDER = (WORST, BEST, MEDIAN)
"""What is kept first where there are too many methods for `MAX_TRIALS`."""


def choose_trials(
    records: Iterable[Record], named: Sequence[Record] = (), limit: int = MAX_TRIALS
) -> tuple[list[tuple[str, Record]], int]:
    """The trials to be shown, method by method, and why each one is.

    Of each goal condition, world, perception and method these are the runs of trials with the lowest, the median and
    the highest strict IoU (the lower of two medians; ties by key). Trials without a matching have nothing to show.

    Args:
        records: of one report.
        named: some of them, which are shown in any case, and first.
        limit: number of others; where it does not suffice, medians are left out first, and best ones next.

    Returns:
        (why, record), ...; and the number of trials that were left out.
    """
    groups: dict[tuple[str, ...], list[Record]] = {}
    for record in sorted(records, key=lambda record: (record.iou_strict, record.key.values)):
        if _pairs(record):
            key = record.key
            groups.setdefault((key.goals, key.world, key.perception, key.method), []).append(record)
    taken = {record.key for record in named}
    chosen: list[tuple[int, str, Record]] = []
    order = sorted(groups, key=_place)
    for why in ORDER:
        for place, group in enumerate(order):
            ranked = groups[group]
            record = {WORST: ranked[0], BEST: ranked[-1], MEDIAN: ranked[(len(ranked) - 1) // 2]}[why]
            if record.key not in taken:
                taken.add(record.key)
                chosen.append((place, why, record))
    kept = sorted(chosen[:limit], key=lambda item: (item[0], item[2].iou_strict, item[2].key))
    return [(NAMED, record) for record in named] + [(why, record) for _, why, record in kept], len(chosen) - len(kept)


def pairs_of(record: Record) -> tuple[tuple[int, int, float], ...]:
    """((reached, goal, IoU), ...) of the matching that the record's scores are computed from; empty where unknown."""
    return tuple((int(i), int(j), float(iou)) for i, j, iou in _pairs(record))


def _pairs(record: Record) -> Sequence[Sequence[float]]:
    return record.events[-1].get("pairs", ()) if record.events else ()


def _place(group: tuple[str, ...]) -> tuple[bool | int | str, ...]:
    """Goal conditions in their own order, the reference method before the others."""
    goals, world, perception, method = group
    place = GOALS.index(goals) if goals in GOALS else len(GOALS)
    return place, goals, world, perception, method != AGAINST, method
