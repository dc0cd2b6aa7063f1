"""Human Rating as in Table I: what people gave, how certain the means are, and how far the raters agree.

The mean and the standard deviation are those of the single ratings, the last answer of every rater to every pair.
Intervals take raters and trials both as random (see `_interval`). Attention checks decide which raters count; the
ratings of checks enter no table.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutgrammar.results.comparisons import ALL, Cell, Condition
from cutgrammar.results.rater_agreement import ordinal_alpha
from cutgrammar.results.samples import Unit, to_numbers
from cutgrammar.results.statistics import N_RESAMPLES
from cutgrammar.seeds import stream
from cutgrammar.storage.ratings import HIGHEST, LOWEST, Rating, last_answers
from cutgrammar.trials.rating_plan import OTHER, RESULT, SAME

NAME = "human_rating"
EXPECTED = {SAME: (4, HIGHEST), OTHER: (LOWEST, 2)}
"""Kind of check -> lowest and highest rating that passes it."""
MIN_CHECKS = 2
"""Checks that a rater must have answered to count."""
MAX_MISSED = 0.25
"""Share of their checks that a rater who counts may miss."""
MAX_WEIGHTS = 2_000_000
"""Weights of resampled ratings in memory at once."""


@dataclass(frozen=True)
class Verdict:
    """Whether a rater counts.

    Attributes:
        rater: code.
        ratings: number of pairs rated, without checks.
        changed: number of answers that were changed later.
        checks, missed: number of checks answered, and of those with an unexpected rating.
        reason: why the rater does not count; "" if they do.
    """

    rater: str
    ratings: int
    changed: int
    checks: int
    missed: int
    reason: str


@dataclass(frozen=True, eq=False)
class HumanRatings:
    """The ratings of an evaluation.

    Attributes:
        fields: condition -> (setup or `ALL`, method) -> the fields of a row: NAME_mean, NAME_std, NAME_ci95,
            NAME_ratings and NAME_raters.
        over_setups: condition -> method -> the same of the mean over setups.
        raters: a verdict on each, by code.
        alpha: Krippendorff's alpha of the raters who count; None where it is not known.
        shared: number of pairs with two ratings or more, from which alpha follows.
    """

    fields: Mapping[Condition, Mapping[Cell, Mapping[str, Any]]]
    over_setups: Mapping[Condition, Mapping[str, Mapping[str, Any]]]
    raters: tuple[Verdict, ...]
    alpha: float | None
    shared: int

    def to_json(self) -> dict[str, Any]:
        """The raters and their agreement as JSON data."""
        return {"alpha": self.alpha, "shared_pairs": self.shared, "raters": [vars(one) for one in self.raters]}


@dataclass(frozen=True)
class _Rated:
    """One rating of a trial."""

    rater: str
    unit: Unit
    value: int


def human_ratings(ratings: Sequence[Rating], trials: Mapping[str, tuple[Condition, str, Unit]]) -> HumanRatings | None:
    """What the ratings say of these trials; None if there are none of them.

    Args:
        ratings: all answers, in any order.
        trials: digest of a trial's key -> its condition, method and unit.
    """
    known = [rating for rating in ratings if rating.trial in trials]
    if not known:
        return None
    last = last_answers(known)
    verdicts = judge(known)
    counting = {verdict.rater for verdict in verdicts if not verdict.reason}
    used = [rating for rating in last if rating.rater in counting and rating.kind == RESULT]
    groups: dict[tuple[Condition, str], list[_Rated]] = {}
    for rating in used:
        condition, method, unit = trials[rating.trial]
        groups.setdefault((condition, method), []).append(_Rated(rating.rater, unit, rating.rating))
    fields: dict[Condition, dict[Cell, Mapping[str, Any]]] = {}
    over: dict[Condition, dict[str, Mapping[str, Any]]] = {}
    for (condition, method), rated in groups.items():
        cells = fields.setdefault(condition, {})
        for setup in sorted({one.unit[0] for one in rated}):
            cells[setup, method] = _fields([one for one in rated if one.unit[0] == setup], (setup, method, *condition))
        cells[ALL, method] = _fields(rated, (ALL, method, *condition))
        over.setdefault(condition, {})[method] = _fields(rated, ("setups", method, *condition), balanced=True)
    counts: dict[str, list[int]] = {}
    for rating in used:
        counts.setdefault(rating.pair, [0] * (HIGHEST - LOWEST + 1))[rating.rating - LOWEST] += 1
    shared = sum(sum(row) > 1 for row in counts.values())
    return HumanRatings(fields, over, verdicts, ordinal_alpha(list(counts.values())) if counts else None, shared)


def judge(ratings: Sequence[Rating]) -> tuple[Verdict, ...]:
    """Which raters count, by code.

    A rater does not count if one of their answers came from a test robot, if they have answered fewer than `MIN_CHECKS`
    attention checks, or if they have missed more than the share `MAX_MISSED` of them.

    Args:
        ratings: all answers, in any order.
    """
    answers, robots = Counter(rating.rater for rating in ratings), {rating.rater for rating in ratings if rating.robot}
    last: dict[str, list[Rating]] = {}
    for rating in last_answers(ratings):
        last.setdefault(rating.rater, []).append(rating)
    verdicts = []
    for rater, own in sorted(last.items()):
        checks = [rating for rating in own if rating.kind in EXPECTED]
        missed = sum(not EXPECTED[rating.kind][0] <= rating.rating <= EXPECTED[rating.kind][1] for rating in checks)
        reason = ""
        if rater in robots:
            reason = "a test robot"
        elif len(checks) < MIN_CHECKS:
            reason = f"fewer than {MIN_CHECKS} attention checks answered"
        elif missed > MAX_MISSED * len(checks):
            reason = f"missed {missed} of {len(checks)} attention checks"
        verdicts.append(Verdict(rater, len(own) - len(checks), answers[rater] - len(own), len(checks), missed, reason))
    return tuple(verdicts)


def _fields(rated: Sequence[_Rated], names: Iterable[str], balanced: bool = False) -> dict[str, Any]:
    """The fields of a row; `names` names the random stream of its interval."""
    values = np.array([one.value for one in rated], dtype=np.float64)
    setups = np.array(to_numbers(one.unit[0] for one in rated))
    weights = np.ones(len(values))
    mean = float(_means(weights[None], values, setups, balanced)[0])
    return {
        f"{NAME}_mean": mean,
        f"{NAME}_std": float(values.std(ddof=1)) if len(values) > 1 else None,
        f"{NAME}_ci95": _interval(rated, stream(0, "report", NAME, *names), balanced),
        f"{NAME}_ratings": len(values),
        f"{NAME}_raters": len({one.rater for one in rated}),
    }


def _interval(rated: Sequence[_Rated], rng: np.random.Generator, balanced: bool) -> list[float] | None:
    """Ends of the 95 % interval of the mean, raters and trials both taken as random.

    Raters are resampled, and trials within their setup, independently of one another; a rating counts as often as its
    rater times its trial (A. B. Owen, "The pigeonhole bootstrap", 2007, which errs towards wide intervals). None with a
    single rater, or where a setup has a single trial.
    """
    raters, units = np.array(to_numbers(one.rater for one in rated)), np.array(to_numbers(one.unit for one in rated))
    setups = np.array(to_numbers(one.unit[0] for one in rated))
    strata = [np.unique(units[setups == setup]) for setup in np.unique(setups)]
    n_raters, n_units = int(raters.max()) + 1, int(units.max()) + 1
    if n_raters < 2 or min(map(len, strata)) < 2:
        return None
    values = np.array([one.value for one in rated], dtype=np.float64)
    means = []
    batch = max(1, MAX_WEIGHTS // len(values))
    for first in range(0, N_RESAMPLES, batch):
        size = min(batch, N_RESAMPLES - first)
        of_raters = rng.multinomial(n_raters, np.full(n_raters, 1.0 / n_raters), size)
        of_units = np.zeros((size, n_units))
        for stratum in strata:
            of_units[:, stratum] = rng.multinomial(len(stratum), np.full(len(stratum), 1.0 / len(stratum)), size)
        means.append(_means(of_raters[:, raters] * of_units[:, units], values, setups, balanced))
    known = np.concatenate(means)
    known = known[np.isfinite(known)]  # a resample without any rating of a setup has no mean
    return [float(end) for end in np.quantile(known, [0.025, 0.975])] if len(known) else None


def _means(weights: np.ndarray[Any, Any], values: Any, setups: Any, balanced: bool) -> np.ndarray[Any, Any]:
    """(b,) weighted means of the values for (b, n) weights; NaN without weight. Balanced: every setup counts once."""
    groups = [setups == setup for setup in np.unique(setups)] if balanced else [np.ones(len(values), dtype=bool)]
    with np.errstate(invalid="ignore"):
        parts = [(weights[:, group] @ values[group]) / weights[:, group].sum(axis=1) for group in groups]
    return np.asarray(np.mean(parts, axis=0))
