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
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.grammar.type_means import nearest_types
from cutgrammar.nn.cross_validation import grouped_folds
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
        held_out_mean: log likelihood of a fold's held-out trials; None if no trials could be held out.
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
        curve: one point for every k that was tried.
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
    progress: Callable[[int, int], object] | None = None,
) -> Induction:
    """Induce the MAP grammar of a corpus (Eq. 1) and the types of its fragments.

    Args:
        corpus: training fragments and cuts.
        settings: the range of k, the restarts, and the candidates for gamma.
        rng: random stream; the same stream gives the same grammar.
        progress: called with the number of finished clusterings and their total.

    Raises:
        InputError: `settings.fixed_k` is outside the range of k.
    """
    folds = [pair for _ in range(settings.n_repeats) for pair in _folds(corpus, settings.n_folds, rng)]
    streams = rng.spawn(1 + len(folds))
    total, done = (1 + len(folds)) * settings.max_k, 0

    def step() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, total)

    held_out: list[tuple[list[list[_Fit]], list[list[float]]]] = []
    for (rest, held_out_corpus), stream in zip(folds, streams[1:], strict=True):
        features = _standardised(rest.features, rest.features)
        others = _standardised(held_out_corpus.features, rest.features)
        fits = _all_fits(rest, features, settings, stream, step)
        held_out.append((fits, [[_log_held_out(fit, rest, held_out_corpus, others) for fit in row] for row in fits]))
    unit = 0.5 * log(len(corpus.features)) * (corpus.features.shape[1] + 1)
    candidates = [multiple * unit for multiple in settings.gammas]
    gammas = tuple(_gamma_score(gamma, held_out, settings) for gamma in candidates) if held_out else ()
    gamma = max(gammas, key=lambda score: score.held_out).gamma if gammas else candidates[0]

    fits = _all_fits(corpus, _standardised(corpus.features, corpus.features), settings, streams[0], step)
    allowed = [fit for row in fits for fit in row if settings.fixed_k in (0, fit.k)]
    if not allowed:
        raise InputError(
            f"induction.fixed_k = {settings.fixed_k} is too large; at most {fits[-1][0].k} types are tried"
        )
    best = max(allowed, key=lambda fit: fit.objective(gamma, settings))
    types = _largest_first(best.clustering.types, corpus.features)
    curve = tuple(_curve_point(row, i, gamma, held_out, settings) for i, row in enumerate(fits))
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
    """Features (n, d), centred and scaled with the mean and the overall standard deviation of the reference (m, d).

    A common scale for all d preserves ratios of distances between features z = (z_shape, z_scale).
    """
    deviation = float(np.sqrt(reference.var(axis=0).mean()))
    return np.asarray((features - reference.mean(axis=0)) / max(deviation, 1e-300))


def _all_fits(
    corpus: Corpus, features: Floats, settings: InductionSettings, rng: np.random.Generator, step: Callable[[], None]
) -> list[list[_Fit]]:
    """The clusterings of all restarts for k = 1, 2, ... up to the limit given by the settings and the corpus."""
    max_k = min(settings.max_k, len(np.unique(features, axis=0)))
    cuts = CutArrays.of(corpus, max_k, rng)
    rows = []
    for k, stream in enumerate(rng.spawn(max_k), start=1):
        rows.append(
            [_fit(corpus, features, cuts, k, settings, stream) for _ in range(settings.n_starts if k > 1 else 1)]
        )
        step()
    return rows


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


def _gamma_score(
    gamma: float, held_out: Sequence[tuple[list[list[_Fit]], list[list[float]]]], settings: InductionSettings
) -> GammaScore:
    ks, total = [], 0.0
    for fits, likelihoods in held_out:
        flat = [
            (fit, value)
            for row, values in zip(fits, likelihoods, strict=True)
            for fit, value in zip(row, values, strict=True)
        ]
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
    row: list[_Fit],
    i: int,
    gamma: float,
    held_out: Sequence[tuple[list[list[_Fit]], list[list[float]]]],
    settings: InductionSettings,
) -> CurvePoint:
    objectives = np.array([fit.objective(gamma, settings) for fit in row])
    productions = np.array([fit.log_productions for fit in row])
    emissions = np.array([fit.log_emission for fit in row])
    likelihoods = [float(np.mean(values[i])) for _, values in held_out if i < len(values)]
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
