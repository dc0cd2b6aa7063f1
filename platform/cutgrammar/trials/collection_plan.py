"""Which demonstrations a data set is to have: how many of each setup, and with which categories (IV-A)."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from cutgrammar.demonstration import CATEGORIES
from cutgrammar.errors import InputError
from cutgrammar.trials.setups import SETUPS, Setup, setup_called


@dataclass(frozen=True)
class PlannedTrial:
    """A demonstration to be made.

    Attributes:
        trial: its number in the data set.
        setup: how many objects are cut into how many categories.
        categories: which, in the order of `CATEGORIES`.
    """

    trial: int
    setup: Setup
    categories: tuple[str, ...]


def plan_trials(total: int, setups: Sequence[str] | None = None) -> tuple[PlannedTrial, ...]:
    """Spread `total` trials over setups in the proportions of the paper's 110; each setup gets at least one.

    Trials are numbered setup by setup, in the order of `SETUPS`. Within a setup every set of categories comes equally
    often, and those that come first name every category equally often too.

    Args:
        total: number of trials.
        setups: names of setups; None for all.

    Raises:
        InputError: an unknown setup, none at all, or fewer trials than setups.
    """
    asked = {setup_called(name).name for name in (SETUPS if setups is None else setups)}
    chosen = [setup for setup in SETUPS.values() if setup.name in asked]
    if not chosen:
        raise InputError(f"no setup was asked for; known: {', '.join(SETUPS)}")
    if total < len(chosen):
        raise InputError(f"{total} trials are too few for {len(chosen)} setups: each gets at least one")
    counts = apportion(total, {setup.name: setup.share for setup in chosen})
    for name in [name for name, count in counts.items() if count == 0]:
        counts[max(counts, key=lambda other: counts[other])] -= 1
        counts[name] = 1
    sets = [(setup, categories) for setup in chosen for categories in _category_sets(setup, counts[setup.name])]
    return tuple(PlannedTrial(trial, *what) for trial, what in enumerate(sets))


def apportion(total: int, shares: Mapping[str, float]) -> dict[str, int]:
    """`total` things dealt out in proportion to `shares`: whole ones first, then by the largest remainders.

    Ties go to whoever comes first.
    """
    exact = {name: total * share / sum(shares.values()) for name, share in shares.items()}
    dealt = {name: int(wanted + 1e-9) for name, wanted in exact.items()}
    neediest = sorted(shares, key=lambda name: round(dealt[name] - exact[name], 9))
    for name in neediest[: total - sum(dealt.values())]:
        dealt[name] += 1
    return dealt


def _category_sets(setup: Setup, count: int) -> list[tuple[str, ...]]:
    """`count` sets of categories, each time one that came least often so far, of those whose categories did."""
    sets = list(combinations(CATEGORIES, setup.categories))
    used: Counter[tuple[str, ...]] = Counter()
    named: Counter[str] = Counter()
    result = []
    for _ in range(count):
        chosen = min(sets, key=lambda option: (used[option], sum(named[name] for name in option), sets.index(option)))
        used[chosen] += 1
        named.update(chosen)
        result.append(chosen)
    return result
