"""The demonstrations of a data set: how many of each setup, and with which categories (IV-A)."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from cutgrammar.demonstration import CATEGORIES
from cutgrammar.errors import InputError
from cutgrammar.trials.setups import SETUPS, Setup, setup_named


@dataclass(frozen=True)
class PlannedTrial:
    """A demonstration to be made.

    Attributes:
        trial: its number in the data set.
        setup: its numbers of objects and categories.
        categories: its categories, in the order of `CATEGORIES`.
    """

    trial: int
    setup: Setup
    categories: tuple[str, ...]


def plan_trials(total: int, setups: Sequence[str] | None = None) -> tuple[PlannedTrial, ...]:
    """Distribute `total` trials over setups in the proportions of the paper's 110; each setup gets at least one.

    Trials are numbered setup by setup, in the order of `SETUPS`. Within a setup all sets of categories occur equally
    often, and the first trials of a setup already use all categories about equally often.

    Args:
        total: number of trials.
        setups: names of setups; None for all.

    Raises:
        InputError: a setup is unknown, there is no setup, or there are fewer trials than setups.
    """
    requested = {setup_named(name).name for name in (SETUPS if setups is None else setups)}
    chosen = [setup for setup in SETUPS.values() if setup.name in requested]
    if not chosen:
        raise InputError(f"at least one setup is needed; known: {', '.join(SETUPS)}")
    if total < len(chosen):
        raise InputError(
            f"{total} trials are too few for {len(chosen)} setups, each of which gets at least one; give --trials "
            f"{len(chosen)} or more, or fewer setups: --setups {' '.join(setup.name for setup in chosen[:total])}"
        )
    counts = apportion(total, {setup.name: setup.share for setup in chosen})
    for name in [name for name, count in counts.items() if count == 0]:
        counts[max(counts, key=lambda other: counts[other])] -= 1
        counts[name] = 1
    sets = [(setup, categories) for setup in chosen for categories in _category_sets(setup, counts[setup.name])]
    return tuple(PlannedTrial(trial, *what) for trial, what in enumerate(sets))


def apportion(total: int, shares: Mapping[str, float]) -> dict[str, int]:
    """Divide `total` items in proportion to `shares` by the largest remainder method; in a tie the first name wins."""
    exact = {name: total * share / sum(shares.values()) for name, share in shares.items()}
    result = {name: int(share + 1e-9) for name, share in exact.items()}
    by_remainder = sorted(shares, key=lambda name: round(result[name] - exact[name], 9))
    for name in by_remainder[: total - sum(result.values())]:
        result[name] += 1
    return result


def _category_sets(setup: Setup, count: int) -> list[tuple[str, ...]]:
    """`count` sets of categories: each is the least used one so far; in a tie, that with the least used categories."""
    sets = list(combinations(CATEGORIES, setup.categories))
    used_sets: Counter[tuple[str, ...]] = Counter()
    used_categories: Counter[str] = Counter()
    result = []
    for _ in range(count):
        chosen = min(
            sets,
            key=lambda option: (used_sets[option], sum(used_categories[name] for name in option), sets.index(option)),
        )
        used_sets[chosen] += 1
        used_categories.update(chosen)
        result.append(chosen)
    return result
