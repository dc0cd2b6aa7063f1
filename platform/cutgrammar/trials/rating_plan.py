"""Which pairs of goal and result a rater sees, and in which order (IV-B2, Human Rating).

Half of a rater's pairs are the same for all raters, so that their agreement can be computed; the other half are the
rater's own, so that many trials are rated. Both halves are spread evenly over strata: method, setup, goal condition,
world and perception. Within a setup the methods are shown on the same goals as far as they have them.

Attention checks lie among the pairs: a goal beside itself, and a goal beside another with at least twice or at most
half as many fragments. A rater cannot tell them from other pairs but by looking.
"""

import hashlib
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutgrammar.seeds import stream
from cutgrammar.trials.record import Record, TrialKey

RESULT, SAME, OTHER = "result", "same", "other"
"""Kinds of pairs: a goal beside what a method reached, beside itself, beside another goal."""
KINDS = (RESULT, SAME, OTHER)
PAIRS_A_CHECK = 10
"""For so many pairs there is one check of each kind, and at least one in all."""
CLEARLY_OTHER = 2.0
"""Ratio of the numbers of fragments from which two goals are clearly different."""

Stratum = tuple[str, str, str, str, str]
Goal = tuple[str, str, int, str]


@dataclass(frozen=True)
class Pair:
    """What a rater compares.

    Attributes:
        kind: one of `KINDS`.
        key: the trial whose goal is shown, and what it reached for the kind `RESULT`.
        other: the trial whose goal is shown as the result, for the kind `OTHER`.
    """

    kind: str
    key: TrialKey
    other: TrialKey | None = None

    @property
    def digest(self) -> str:
        """sha256, which tells pairs apart."""
        parts = (self.kind, self.key.digest, self.other.digest if self.other else "")
        return hashlib.sha256(" ".join(parts).encode()).hexdigest()


def number_of_checks(pairs: int) -> int:
    """Number of attention checks of each kind among `pairs` pairs."""
    return max(1, round(pairs / PAIRS_A_CHECK))


def plan_of_rater(records: Sequence[Record], rater: str, pairs: int, seed: int) -> tuple[Pair, ...]:
    """The pairs of a rater with their attention checks, in the order in which they are shown.

    Args:
        records: the trials that can be shown, in any order.
        rater: code of the rater, which has an order of its own.
        pairs: number of pairs, without checks; fewer where there are fewer trials.
        seed: of the drawing.

    Returns:
        The plan: the same for the same arguments.
    """
    pool = _Pool(records, seed)
    common = pool.draw(math.ceil(pairs / 2), "common", [])
    chosen = common + pool.draw(pairs - len(common), f"rater {rater}", common)
    rng = stream(seed, "rate", "order", rater)
    shown = _apart([Pair(RESULT, key) for key in chosen], rng)
    return _with_checks(shown, pool.checks(number_of_checks(len(shown)), rng), rng) if shown else ()


def goal_of(key: TrialKey) -> Goal:
    """What trials with one goal share."""
    return key.origin, key.setup, key.trial, key.goals


def stratum_of(key: TrialKey) -> Stratum:
    """What the pairs are spread over."""
    return key.method, key.setup, key.goals, key.world, key.perception


class _Pool:
    """The trials that can be shown, by stratum and goal."""

    def __init__(self, records: Sequence[Record], seed: int) -> None:
        self._seed = seed
        self._strata: dict[Stratum, dict[Goal, list[TrialKey]]] = {}
        self._fragments: dict[Goal, tuple[int, TrialKey]] = {}
        for record in sorted(records, key=lambda record: record.key):
            key = record.key
            self._strata.setdefault(stratum_of(key), {}).setdefault(_place(key), []).append(key)
            self._fragments.setdefault(goal_of(key), (record.goal_fragments, key))

    def draw(self, number: int, purpose: str, already: Sequence[TrialKey]) -> list[TrialKey]:
        """Up to `number` trials beside those drawn already, every stratum as often as the others."""
        rank = {stratum: float(stream(self._seed, "rate", purpose, *stratum).random()) for stratum in self._strata}
        counts, margins = Counter(map(stratum_of, already)), Counter(part for key in already for part in _margins(key))
        used = {stratum: {_place(key) for key in already if stratum_of(key) == stratum} for stratum in self._strata}
        drawn: list[TrialKey] = []
        while len(drawn) < number:
            free = [stratum for stratum, places in self._strata.items() if len(used[stratum]) < len(places)]
            if not free:
                break
            stratum = min(free, key=lambda s: (counts[s], *(margins[i, part] for i, part in enumerate(s)), rank[s]))
            place = next(place for place in self._order(stratum, purpose) if place not in used[stratum])
            runs = self._strata[stratum][place]
            key = runs[int(stream(self._seed, "rate", purpose, "run", *stratum, *place).integers(len(runs)))]
            drawn.append(key)
            used[stratum].add(place)
            counts[stratum] += 1
            margins.update(_margins(key))
        return drawn

    def checks(self, number: int, rng: np.random.Generator) -> list[tuple[Pair, ...]]:
        """`number` groups of checks, one of each kind; `SAME` alone where no goals are clearly different."""
        goals = sorted(self._fragments)
        groups = []
        for _ in range(number):
            one = self._fragments[goals[int(rng.integers(len(goals)))]]
            group = [Pair(SAME, one[1])]
            first = self._fragments[goals[int(rng.integers(len(goals)))]]
            others = [other for goal in goals if _differs(first[0], (other := self._fragments[goal])[0])]
            if others:
                group.append(Pair(OTHER, first[1], others[int(rng.integers(len(others)))][1]))
            groups.append(tuple(group[i] for i in rng.permutation(len(group))))
        return groups

    def _order(self, stratum: Stratum, purpose: str) -> list[Goal]:
        """The goals of a stratum in an order that all methods share."""
        rank = {place: stream(self._seed, "rate", purpose, "goal", *place).random() for place in self._strata[stratum]}
        return sorted(rank, key=lambda place: (rank[place], place))


def _place(key: TrialKey) -> Goal:
    """The trial of a stratum, whatever its run; models of one evaluation have different origins but the same trials."""
    return "", key.setup, key.trial, key.goals


def _margins(key: TrialKey) -> list[tuple[int, str]]:
    return list(enumerate(stratum_of(key)))


def _differs(one: int, other: int) -> bool:
    return max(one, other) >= CLEARLY_OTHER * max(min(one, other), 1)


def _apart(pairs: Sequence[Pair], rng: np.random.Generator) -> list[Pair]:
    """The pairs in random order; two with the same goal follow one another only where there is no other way."""
    left = [pairs[i] for i in rng.permutation(len(pairs))]
    order: list[Pair] = []
    while left:
        last = _place(order[-1].key) if order else None
        crowded = Counter(_place(pair.key) for pair in left)
        most, times = crowded.most_common(1)[0]
        must = most if 2 * times > len(left) and most != last else None
        fits = (pair for pair in left if (_place(pair.key) == must if must else _place(pair.key) != last))
        pair = next(fits, left[0])
        left.remove(pair)
        order.append(pair)
    return order


def _with_checks(
    pairs: Sequence[Pair], groups: Sequence[tuple[Pair, ...]], rng: np.random.Generator
) -> tuple[Pair, ...]:
    """The pairs with the checks among them: as many parts as checks, each with one check at a random place."""
    checks = [check for group in groups for check in group]
    parts = np.array_split(np.arange(len(pairs)), len(checks))
    shown: list[Pair] = []
    for check, part in zip(checks, parts, strict=True):
        own = [pairs[int(i)] for i in part]
        place = int(rng.integers(len(own) + 1))
        shown += [*own[:place], check, *own[place:]]
    return tuple(shown)
