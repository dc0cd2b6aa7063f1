"""Fragments into k types: k-means on standardised features whose assignment also counts the productions (II-B).

For a fixed k this maximises the two likelihoods of the MAP objective (see `induction`),

    sum over cuts of log p(alpha -> beta)  +  sum over fragments of log N(z; mean of its type, sigma^2 I),

p by Eq. (2) and the means at their best for the types given. sigma is given and the same for all types and all k, as in
DP-means: were it fitted too, it would shrink as k grows and reward every further type almost alike. Like k-means and
DP-means it alternates between the means, in closed form, and the types, one fragment at a time, each to its best type;
so the objective never falls. The productions enter once plain k-means has settled. No type is left without a fragment.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.grammar.corpus import Corpus

MOST_SWEEPS = 100
"""Most passes over the fragments; they settle long before."""


@dataclass(frozen=True, eq=False)
class CutArrays:
    """The cuts of a corpus as compiled code takes them.

    Attributes:
        members: (m, w) the fragment cut, then what it became, -1 where there are no more.
        cuts_of: (n, 2) the cut that divides each fragment and the cut that made it, -1 for none.
        codes: (largest k, 2) random numbers; a production is known by the sum of its parent's first and its children's
            second, in whatever order they come.
    """

    members: Ints
    cuts_of: Ints
    codes: Ints

    @staticmethod
    def of(corpus: Corpus, max_k: int, rng: np.random.Generator) -> "CutArrays":
        """The cuts of `corpus`, for up to `max_k` types."""
        members = np.full((len(corpus.cuts), 1 + max(len(made) for _, made in corpus.cuts)), -1, dtype=np.int64)
        cuts_of = np.full((len(corpus.trials), 2), -1, dtype=np.int64)
        for i, (cut, made) in enumerate(corpus.cuts):
            members[i, : 1 + len(made)] = cut, *made
            cuts_of[cut, 0] = i
            cuts_of[list(made), 1] = i
        return CutArrays(members, cuts_of, rng.integers(-(2**62), 2**62, size=(max_k, 2)))


@dataclass(frozen=True, eq=False)
class Clustering:
    """What one run of the alternation came to.

    Attributes:
        types: (n,) type of every fragment, 0 to k - 1.
        means: (k, d) mean feature of each type.
        variance: sigma^2.
    """

    types: Ints
    means: Floats
    variance: float

    def log_emission(self, features: Floats, types: Ints) -> float:
        """Sum over fragments of log N(z; mean of its type, sigma^2 I) for features (n, d) of these types (n,)."""
        squares = float(((features - self.means[types]) ** 2).sum())
        return float(-0.5 * (features.size * np.log(2.0 * np.pi * self.variance) + squares / self.variance))

    def nearest(self, features: Floats) -> Ints:
        """(n,) the type whose mean lies nearest to each of the features (n, d)."""
        return np.asarray(((features[:, None] - self.means) ** 2).sum(axis=2).argmin(axis=1))


def cluster(features: Floats, cuts: CutArrays, k: int, variance: float, rng: np.random.Generator) -> Clustering:
    """One run of the alternation from a random start (k-means++).

    Args:
        features: (n, d) standardised features.
        cuts: of the same fragments.
        k: number of types, at most the number of different features.
        variance: sigma^2.
        rng: random stream.
    """
    means = _seed(features, k, rng.random(k))
    types = Clustering(np.zeros(0, dtype=np.int64), means, 1.0).nearest(features)
    _settle(features, types, k, variance, 0.0, cuts.members, cuts.cuts_of, cuts.codes)
    means = _settle(features, types, k, variance, 1.0, cuts.members, cuts.cuts_of, cuts.codes)
    return Clustering(types, means, variance)


@njit(cache=True)
def _seed(features, k, draws):  # type: ignore[no-untyped-def]
    """k-means++: means drawn from the fragments, each by its squared distance from those before it."""
    n = len(features)
    means = np.empty((k, features.shape[1]))
    closest = np.full(n, np.inf)
    chosen = int(draws[0] * n)
    for c in range(k):
        means[c] = features[chosen]
        for i in range(n):
            closest[i] = min(closest[i], _squared_distance(features[i], means[c]))
        if c + 1 < k:
            at = draws[c + 1] * closest.sum()
            for i in range(n):
                if closest[i] > 0.0:
                    chosen = i
                    at -= closest[i]
                    if at < 0.0:
                        break
    return means


@njit(cache=True)
def _squared_distance(a, b):  # type: ignore[no-untyped-def]
    total = 0.0
    for j in range(len(a)):
        total += (a[j] - b[j]) ** 2
    return total


@njit(cache=True)
def _moments(features, types, k):  # type: ignore[no-untyped-def]
    """Means (k, d) and sizes (k,) of the types."""
    means, sizes = np.zeros((k, features.shape[1])), np.zeros(k, np.int64)
    for i in range(len(types)):
        means[types[i]] += features[i]
        sizes[types[i]] += 1
    for c in range(k):
        means[c] /= max(sizes[c], 1)
    return means, sizes


@njit(cache=True)
def _settle(features, types, k, variance, weight, members, cuts_of, codes):  # type: ignore[no-untyped-def]
    """Alternate, changing `types` in place, until no fragment finds a better type; the means then.

    `weight` is that of the productions: 0 for plain k-means.
    """
    # What moving one fragment can gain: in one cut it may be the parent, in one other a child.
    most_gain = weight * 3.0 * (np.log(len(members)) + 1.0)
    now = _log_productions(types, k, members, codes)
    for _ in range(MOST_SWEEPS):
        means, sizes = _moments(features, types, k)
        moved = False
        for i in range(len(types)):
            old = types[i]
            if sizes[old] == 1:
                continue
            best, then = old, now
            best_value = -_squared_distance(features[i], means[old]) / (2.0 * variance)
            for c in range(k):
                value = -_squared_distance(features[i], means[c]) / (2.0 * variance)
                if c == old or value + most_gain <= best_value:
                    continue
                productions = now
                if weight > 0.0 and (cuts_of[i, 0] >= 0 or cuts_of[i, 1] >= 0):
                    types[i] = c
                    productions = _log_productions(types, k, members, codes)
                    value += weight * (productions - now)
                if value > best_value + 1e-9:
                    best, best_value, then = c, value, productions
            types[i] = best
            if best != old:
                moved = True
                now = then
                sizes[old] -= 1
                sizes[best] += 1
        if not moved:
            break
    return _moments(features, types, k)[0]


@njit(cache=True)
def _log_productions(types, k, members, codes):  # type: ignore[no-untyped-def]
    """Sum over cuts of log p(alpha -> beta) with the frequencies of Eq. (2)."""
    known_as, uses = np.empty(len(members), np.int64), np.zeros(k)
    for cut in range(len(members)):
        parent = types[members[cut, 0]]
        uses[parent] += 1.0
        known_as[cut] = codes[parent, 0]
        for j in range(1, members.shape[1]):
            if members[cut, j] >= 0:
                known_as[cut] += codes[types[members[cut, j]], 1]
    known_as.sort()
    total, run = 0.0, 0.0
    for cut in range(len(members)):
        run += 1.0
        if cut + 1 == len(members) or known_as[cut + 1] != known_as[cut]:
            total += run * np.log(run)
            run = 0.0
    for c in range(k):
        if uses[c] > 0.0:
            total -= uses[c] * np.log(uses[c])
    return total
