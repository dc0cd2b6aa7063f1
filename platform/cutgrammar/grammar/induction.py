"""Grammar induction by MAP (II-B, Eq. 1-2): how many fragment types, which, and how probable their productions.

    G* = argmax over k of   sum over cuts of log p(alpha -> beta | G)
                          + sum over fragments of log p(z | c)
                          + gamma |G|

Readings taken. As printed, Eq. (1) is the first and the third line, and its best k is always 1: with one type the
corpus is certain. The second line is the emission of the mixture that the clustering fits, a Gaussian per type with
one given variance for all, as in DP-means, in features standardised on the training fragments; with it the best k lies
inside. |G| counts types, or types and productions (a setting). gamma is that of the Bayesian information criterion,
half the log of the number of fragments for each number that a type brings, its mean and its share; or a multiple of
it, which may be chosen among candidates by the likelihood of trials held out. There a production never seen gets the
probability that `Smoothed` gives it, and a fragment unlike all types that of one imagined fragment a type, spread as
wide as all the training features are; without it a few such fragments would decide alone.
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
from cutgrammar.nn.cross_validation import folds_of
from cutgrammar.settings import InductionSettings

"""What |G| can count."""


@dataclass(frozen=True)
class CurvePoint:
    """What came of one k over the restarts: means and standard deviations.

    Attributes:
        k: number of types.
        objective_mean, objective_std: Eq. (1) in logs, with the gamma chosen.
        log_productions_mean, log_productions_std: its first term.
        log_emission_mean, log_emission_std: its second term.
        productions_mean: number of different productions.
        held_out_mean: log likelihood of a trial held out, over the folds; None where nothing could be held out.
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
    """A candidate for gamma: the k it chose in every fold, and the log likelihood of the trials held out."""

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
        gamma: coefficient of the prior, as chosen.
        gammas: how every candidate did; empty where there was only one, or nothing to hold out.
        curve: one point for every k tried.
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
    """Probabilities of productions seen or not: Eq. (2) with one imagined cut a type, spread over all productions.

    The imagined cut makes as many fragments as cuts do on the whole, one more cut imagined there too (2 fragments in
    half of it, 3 in a quarter, 4 in an eighth, ...), and the type of each is drawn by the types' frequencies.
    """

    counts: Counter[Production]
    uses: Counter[int]
    sizes: Counter[int]
    shares: Floats

    @staticmethod
    def of(productions: Sequence[Production], types: Ints, k: int) -> "Smoothed":
        """From the productions of a corpus and the types (n,) of its fragments."""
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
        imagined = size * float(np.exp(orders + np.log(self.shares[list(production.children)]).sum()))
        return log((self.counts[production] + imagined) / (self.uses[production.parent] + 1.0))


def induce(
    corpus: Corpus,
    settings: InductionSettings,
    rng: np.random.Generator,
    progress: Callable[[int, int], object] | None = None,
) -> Induction:
    """The MAP grammar of a corpus (Eq. 1), with the types of its fragments.

    Args:
        corpus: training fragments and cuts.
        settings: which k are tried and how.
        rng: random stream; the same stream gives the same grammar.
        progress: told how many of the clusterings are done, and of how many.

    Raises:
        InputError: more types are asked for than were tried.
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
    for (rest, kept_back), stream in zip(folds, streams[1:], strict=True):
        features, others = _standardised(rest.features, rest.features), _standardised(kept_back.features, rest.features)
        fits = _all_fits(rest, features, settings, stream, step)
        held_out.append((fits, [[_log_held_out(fit, rest, kept_back, others) for fit in row] for row in fits]))
    unit = 0.5 * log(len(corpus.features)) * (corpus.features.shape[1] + 1)
    candidates = [multiple * unit for multiple in settings.gammas]
    gammas = tuple(_gamma_score(gamma, held_out, settings) for gamma in candidates) if held_out else ()
    gamma = max(gammas, key=lambda score: score.held_out).gamma if gammas else candidates[0]

    fits = _all_fits(corpus, _standardised(corpus.features, corpus.features), settings, streams[0], step)
    allowed = [fit for row in fits for fit in row if settings.fixed_k in (0, fit.k)]
    if not allowed:
        raise InputError(f"induction.fixed_k = {settings.fixed_k} was not tried; {fits[-1][0].k} types are the most")
    best = max(allowed, key=lambda fit: fit.objective(gamma, settings))
    types = _largest_first(best.clustering.types, corpus.features)
    curve = tuple(_curve_point(row, i, gamma, held_out, settings) for i, row in enumerate(fits))
    return Induction(grammar_of(corpus, types, best.k), types, best.k, gamma, gammas, curve)


def grammar_of(corpus: Corpus, types: Ints, k: int) -> Grammar:
    """The grammar whose probabilities are the frequencies of the corpus' productions (Eq. 2).

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
    """(the others, those held out) for every fold of the trials that have cuts; none with fewer than two folds."""
    trials = corpus.trials[[cut for cut, _ in corpus.cuts]]
    return [
        (corpus.of_trials(trials[rest]), corpus.of_trials(trials[held])) for rest, held in folds_of(trials, folds, rng)
    ]


def _standardised(features: Floats, reference: Floats) -> Floats:
    """Features (n, d) about the reference's (m, d) mean, in units of its deviation, the same for all d.

    One unit for all keeps the distances that z = (z_shape, z_scale) was made for.
    """
    deviation = float(np.sqrt(reference.var(axis=0).mean()))
    return np.asarray((features - reference.mean(axis=0)) / max(deviation, 1e-300))


def _all_fits(
    corpus: Corpus, features: Floats, settings: InductionSettings, rng: np.random.Generator, step: Callable[[], None]
) -> list[list[_Fit]]:
    """The clusterings of every restart for k = 1, 2, ... up to what the settings and the corpus allow."""
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


def _log_held_out(fit: _Fit, rest: Corpus, kept_back: Corpus, features: Floats) -> float:
    """Log likelihood of a corpus held out, its features (n, d) standardised like the others', by nearest types."""
    smoothed = Smoothed.of(rest.productions(fit.clustering.types), fit.clustering.types, fit.k)
    types = fit.clustering.nearest(features)
    cuts = sum(smoothed.log_probability(production) for production in kept_back.productions(types))
    return cuts + float(np.logaddexp(*_typed_and_untyped(fit, features, types)).sum())


def _typed_and_untyped(fit: _Fit, features: Floats, types: Ints) -> tuple[Floats, Floats]:
    """Log densities (n,), (n,) of fragments held out, as of their type and as of none, each with its share.

    Of none is one imagined fragment a type, with the mean and the deviation of the training features: 0 and 1.
    """
    n, d = len(fit.clustering.types), features.shape[1]
    none = fit.k / (n + fit.k)

    def log_density(squares: Floats, variance: float) -> Floats:
        return np.asarray(-0.5 * (d * np.log(2.0 * np.pi * variance) + squares / variance))

    off = ((features - fit.clustering.means[types]) ** 2).sum(axis=1)
    typed = log_density(off, fit.clustering.variance) + np.log1p(-none)
    return typed, log_density((features**2).sum(axis=1), 1.0) + np.log(none)


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
    """The types renumbered by their mean z_scale, the last of the features, the largest first."""
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
