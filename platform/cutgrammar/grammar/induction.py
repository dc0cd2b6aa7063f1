"""Grammar induction by MAP (II-B, Eq. 1-2): the number of fragment types, the types, and their productions.

    G* = argmax over k of   sum over cuts of log p(alpha -> beta | G)
                          + sum over fragments of log p(z | c)
                          + gamma |G|

Readings taken:
- As printed, Eq. (1) consists of the first and the third line, and its maximum is always at k = 1, where the corpus has
  probability 1. The second line is the emission term of the mixture that the clustering fits: one Gaussian per type
  with the same fixed variance, as in DP-means, on features standardised with the training fragments. It moves the
  maximum to the interior of the range of k.
- |G| counts types, or types and productions (a setting).
- gamma is a multiple of its value in the Bayesian information criterion, half the log of the number of fragments for
  each parameter of a type (its mean and its share). It is given or selected by the likelihood of held-out trials.
- For held-out trials, unseen productions get the probability of `Smoothed`. Fragments unlike all types are explained by
  a background Gaussian as wide as all training features, with the weight of one pseudo-fragment per type; otherwise a
  few such fragments would dominate the likelihood.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import lgamma, log

import numpy as np

from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.grammar.clustering import Clustering, CutArrays, cluster
from cutgrammar.grammar.corpus import Corpus
from cutgrammar.grammar.numbers_of_types import between_neighbours, growing_grid, has_turned
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.grammar.type_means import nearest_types
from cutgrammar.nn.cross_validation import grouped_folds
from cutgrammar.nn.mlp import common_deviation_of
from cutgrammar.settings import InductionSettings


@dataclass(frozen=True)
class CurvePoint:
    """The objective at one k: means and standard deviations over the restarts.

    Attributes:
        k: number of types.
        objective_mean, objective_std: log of Eq. (1) with the selected gamma.
        log_productions_mean, log_productions_std: its first term.
        log_emission_mean, log_emission_std: its second term.
        productions_mean: number of distinct productions.
        held_out_mean: log likelihood of a fold's held-out trials; None if none could be held out, or only the whole
            corpus was clustered into k types.
    """

    k: int
    objective_mean: float
    objective_std: float
    log_productions_mean: float
    log_productions_std: float
    log_emission_mean: float
    log_emission_std: float
    productions_mean: float
    held_out_mean: float | None


@dataclass(frozen=True)
class GammaScore:
    """A candidate for gamma: the k that it selects in every fold, and the log likelihood of all held-out trials."""

    gamma: float
    ks: tuple[int, ...]
    held_out: float


@dataclass(frozen=True, eq=False)
class Induction:
    """A grammar induced from a corpus.

    Attributes:
        grammar: the MAP grammar; c0 is the type with the largest fragments.
        types: (n,) type of every fragment of the corpus.
        k: number of types.
        gamma: the selected coefficient of the prior.
        gammas: the score of every candidate; empty if there was only one, or no trials could be held out.
        curve: one point for every k that was tried, ascending.
    """

    grammar: Grammar
    types: Ints
    k: int
    gamma: float
    gammas: tuple[GammaScore, ...]
    curve: tuple[CurvePoint, ...]


@dataclass(frozen=True, eq=False)
class _Fit:
    """One clustering and the terms of its objective."""

    clustering: Clustering
    log_productions: float
    log_emission: float
    productions: int

    @property
    def k(self) -> int:
        return len(self.clustering.means)

    def objective(self, gamma: float, settings: InductionSettings) -> float:
        size = self.k + (self.productions if settings.model_size == "types+productions" else 0)
        return self.log_productions + (self.log_emission if settings.emission else 0.0) + gamma * size


_HeldOut = tuple[dict[int, list[_Fit]], dict[int, list[float]]]
"""Of a fold, by k: the fits of all starts, and the log likelihood of the held-out trials under each."""


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Smoothed probabilities of seen and unseen productions: Eq. (2) with one pseudo-cut per type.

    The pseudo-cut is distributed over all productions. Its number of products follows the observed numbers, smoothed in
    turn by one pseudo-cut with n products with probability 2^-(n-1) for n = 2, 3, ...; the type of each product follows
    the frequencies of the types.
    """

    counts: Counter[Production]
    uses: Counter[int]
    sizes: Counter[int]
    shares: Floats

    @staticmethod
    def of(productions: Sequence[Production], types: Ints, k: int) -> "Smoothed":
        """Estimate the probabilities from the productions of a corpus and the types (n,) of its fragments."""
        return Smoothed(
            Counter(productions),
            Counter(p.parent for p in productions),
            Counter(len(p.children) for p in productions),
            (np.bincount(types, minlength=k) + 1.0) / (len(types) + k),
        )

    def log_probability(self, production: Production) -> float:
        """Log p(alpha -> beta)."""
        n = len(production.children)
        size = (self.sizes[n] + 0.5 ** (n - 1)) / (self.sizes.total() + 1.0)
        orders = lgamma(n + 1) - sum(lgamma(times + 1) for times in Counter(production.children).values())
        pseudo = size * float(np.exp(orders + np.log(self.shares[list(production.children)]).sum()))
        return log((self.counts[production] + pseudo) / (self.uses[production.parent] + 1.0))


def induce(
    corpus: Corpus,
    settings: InductionSettings,
    rng: np.random.Generator,
    progress: Callable[..., object] | None = None,
) -> Induction:
    """Induce the MAP grammar of a corpus (Eq. 1) and the types of its fragments.

    Args:
        corpus: training fragments and cuts.
        settings: the restarts, the candidates for gamma, and perhaps a largest k.
        rng: random stream; the same stream gives the same grammar.
        progress: called with the number of finished steps and the most there can be, which the last call reaches, and
            after a number of types was tried on the whole corpus with ((k, best objective),), for the largest candidate
            for gamma.

    Raises:
        InputError: `settings.fixed_k` exceeds `settings.max_k` or the number of distinct fragments.
    """
    folds = [pair for _ in range(settings.n_repeats) for pair in _folds(corpus, settings.n_folds, rng)]
    streams = rng.spawn(1 + len(folds))
    unit = 0.5 * log(len(corpus.features)) * (corpus.features.shape[1] + 1)
    candidates = [multiple * unit for multiple in settings.gammas]
    own = _Clusterings(corpus, settings, streams[0])
    if settings.fixed_k > own.limit:
        raise InputError(f"induction.fixed_k = {settings.fixed_k} is too large; at most {own.limit} types are tried")
    grid = [*growing_grid(settings.fixed_k or own.limit)]
    total, done = (1 + len(folds)) * len(grid), 0

    def step(steps: int = 1, *curve: tuple[tuple[int, float], ...]) -> None:
        nonlocal done
        done += steps
        if progress is not None:
            progress(done, total, *curve)

    for k in grid:
        own.fit(k, settings.n_starts if k > 1 else 1)
        step(1, ((k, own.objectives(max(candidates))[k]),))
        if not settings.fixed_k and has_turned(own.objectives(max(candidates))):
            break
    ks = sorted(own.rows)
    held_out: list[_HeldOut] = []
    for (rest, held_out_corpus), stream in zip(folds, streams[1:], strict=True):
        fold = _Clusterings(rest, settings, stream)
        others = _standardised(held_out_corpus.features, rest.features)
        for k in ks:
            if k <= fold.limit:
                fold.fit(k, 1)
            step()
        values = {k: [_log_held_out(fit, rest, held_out_corpus, others) for fit in row] for k, row in fold.rows.items()}
        held_out.append((fold.rows, values))
    gammas = tuple(_gamma_score(gamma, held_out, settings) for gamma in candidates) if held_out else ()
    gamma = max(gammas, key=lambda score: score.held_out).gamma if gammas else candidates[0]
    if not settings.fixed_k:
        for k in between_neighbours(own.objectives(gamma)):
            own.fit(k, settings.n_starts if k > 1 else 1)
    if done < total:
        step(total - done)
    allowed = [fit for k, row in own.rows.items() for fit in row if settings.fixed_k in (0, k)]
    best = max(allowed, key=lambda fit: (fit.objective(gamma, settings), -fit.k))
    types = _largest_first(best.clustering.types, corpus.features)
    curve = tuple(_curve_point(own.rows[k], gamma, held_out, settings) for k in sorted(own.rows))
    return Induction(grammar_of(corpus, types, best.k), types, best.k, gamma, gammas, curve)


def grammar_of(corpus: Corpus, types: Ints, k: int) -> Grammar:
    """The grammar whose probabilities are the relative frequencies of the corpus' productions (Eq. 2).

    Args:
        corpus: fragments and cuts.
        types: (n,) type of every fragment, 0 to k - 1.
        k: number of types.
    """
    counts = Counter(corpus.productions(types))
    uses: Counter[int] = Counter()
    for production, times in counts.items():
        uses[production.parent] += times
    return Grammar(
        k=k,
        probabilities={production: counts[production] / uses[production.parent] for production in sorted(counts)},
        frequencies=tuple((np.bincount(types, minlength=k) / len(types)).tolist()),
    )


def _folds(corpus: Corpus, folds: int, rng: np.random.Generator) -> list[tuple[Corpus, Corpus]]:
    """(other trials, held-out trials) for every fold of the trials that have cuts; empty for fewer than two folds."""
    trials = corpus.trials[[cut for cut, _ in corpus.cuts]]
    return [
        (corpus.of_trials(trials[rest]), corpus.of_trials(trials[held]))
        for rest, held in grouped_folds(trials, folds, rng)
    ]


def _standardised(features: Floats, reference: Floats) -> Floats:
    """Features (n, d), centred and scaled with the mean and the common standard deviation of the reference (m, d).

    A common scale for all d preserves ratios of distances between features z = (z_shape, z_scale).
    """
    return np.asarray((features - reference.mean(axis=0)) / common_deviation_of(reference))


class _Clusterings:
    """The clusterings of a corpus for each k that was tried; every k has a random stream of its own.

    Attributes:
        limit: largest k that the settings and the number of distinct fragments allow.
        rows: the fits of all starts, by k.
    """

    def __init__(self, corpus: Corpus, settings: InductionSettings, rng: np.random.Generator) -> None:
        self._corpus, self._settings = corpus, settings
        self._features = _standardised(corpus.features, corpus.features)
        distinct = len(np.unique(self._features, axis=0))
        self.limit = min(settings.max_k or distinct, distinct)
        self._cuts = CutArrays.of(corpus, self.limit, rng)
        self._seed = int(rng.integers(2**63))
        self.rows: dict[int, list[_Fit]] = {}

    def fit(self, k: int, starts: int) -> None:
        """Cluster into k types from so many random starts."""
        rng = np.random.default_rng([self._seed, k])
        self.rows[k] = [_fit(self._corpus, self._features, self._cuts, k, self._settings, rng) for _ in range(starts)]

    def objectives(self, gamma: float) -> dict[int, float]:
        """The best objective at each k tried, with this gamma."""
        return {k: max(fit.objective(gamma, self._settings) for fit in row) for k, row in self.rows.items()}


def _fit(
    corpus: Corpus, features: Floats, cuts: CutArrays, k: int, settings: InductionSettings, rng: np.random.Generator
) -> _Fit:
    found = cluster(features, cuts, k, settings.within_type_std**2, rng)
    productions = corpus.productions(found.types)
    counts = Counter(productions)
    uses = Counter(p.parent for p in productions)
    log_productions = sum(times * log(times / uses[p.parent]) for p, times in sorted(counts.items()))
    return _Fit(found, log_productions, found.log_emission(features, found.types), len(counts))


def _log_held_out(fit: _Fit, rest: Corpus, held_out_corpus: Corpus, features: Floats) -> float:
    """Log likelihood of a held-out corpus, whose features (n, d) are standardised like those of the training corpus."""
    smoothed = Smoothed.of(rest.productions(fit.clustering.types), fit.clustering.types, fit.k)
    types = nearest_types(features, fit.clustering.means)
    cuts = sum(smoothed.log_probability(production) for production in held_out_corpus.productions(types))
    return cuts + float(np.logaddexp(*_typed_and_background(fit, features, types)).sum())


def _typed_and_background(fit: _Fit, features: Floats, types: Ints) -> tuple[Floats, Floats]:
    """Weighted log densities (n,), (n,) of held-out fragments under their type's Gaussian and the background Gaussian.

    The background has the mean and the standard deviation of the training features, 0 and 1, and the weight of one
    pseudo-fragment per type.
    """
    n, d = len(fit.clustering.types), features.shape[1]
    background = fit.k / (n + fit.k)

    def log_density(squares: Floats, variance: float) -> Floats:
        return np.asarray(-0.5 * (d * np.log(2.0 * np.pi * variance) + squares / variance))

    squares = ((features - fit.clustering.means[types]) ** 2).sum(axis=1)
    typed = log_density(squares, fit.clustering.variance) + np.log1p(-background)
    return typed, log_density((features**2).sum(axis=1), 1.0) + np.log(background)


def _gamma_score(gamma: float, held_out: Sequence[_HeldOut], settings: InductionSettings) -> GammaScore:
    ks, total = [], 0.0
    for fits, likelihoods in held_out:
        flat = [pair for k in fits for pair in zip(fits[k], likelihoods[k], strict=True)]
        fit, value = max(flat, key=lambda pair: pair[0].objective(gamma, settings))
        ks.append(fit.k)
        total += value
    return GammaScore(gamma, tuple(ks), total)


def _largest_first(types: Ints, features: Floats) -> Ints:
    """The types renumbered by descending mean z_scale, the last feature."""
    k = int(types.max()) + 1
    scale = np.bincount(types, weights=features[:, -1], minlength=k) / np.bincount(types, minlength=k)
    rank = np.empty(k, dtype=np.int64)
    rank[np.argsort(-scale, kind="stable")] = np.arange(k)
    return np.asarray(rank[types])


def _curve_point(
    row: list[_Fit], gamma: float, held_out: Sequence[_HeldOut], settings: InductionSettings
) -> CurvePoint:
    objectives = np.array([fit.objective(gamma, settings) for fit in row])
    productions = np.array([fit.log_productions for fit in row])
    emissions = np.array([fit.log_emission for fit in row])
    likelihoods = [float(np.mean(values[row[0].k])) for _, values in held_out if row[0].k in values]
    return CurvePoint(
        k=row[0].k,
        objective_mean=float(objectives.mean()),
        objective_std=float(objectives.std()),
        log_productions_mean=float(productions.mean()),
        log_productions_std=float(productions.std()),
        log_emission_mean=float(emissions.mean()),
        log_emission_std=float(emissions.std()),
        productions_mean=float(np.mean([fit.productions for fit in row])),
        held_out_mean=float(np.mean(likelihoods)) if likelihoods else None,
    )
