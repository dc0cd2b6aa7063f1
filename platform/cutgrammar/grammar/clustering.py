"""Clustering of fragments into k types: k-means on standardised features with a likelihood term for productions (II-B).

For a fixed k this maximises the two likelihoods of the MAP objective (see `induction`),

    sum over cuts of log p(alpha -> beta)  +  sum over fragments of log N(z; mean of its type, sigma^2 I),

where p follows from Eq. (2) and the means are optimal for the given types. sigma is fixed and equal for all types and
all k, as in DP-means: a fitted sigma would shrink as k grows and reward every additional type by nearly the same
amount. As in k-means and DP-means, the algorithm alternates between the means, in closed form, and the types, moving
one fragment at a time to its best type; the objective therefore never decreases. The production term is added after
plain k-means has converged. Every type keeps at least one fragment.
"""

from dataclasses import dataclass

import numpy as np
from numba import int64, njit
from numba.typed import Dict

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.grammar.corpus import Corpus
from cutgrammar.grammar.type_means import nearest_types

MAX_SWEEPS = 100
"""Maximum number of passes over the fragments; convergence takes far fewer."""


@dataclass(frozen=True, eq=False)
class CutArrays:
    """The cuts of a corpus as arrays for compiled code.

    Attributes:
        members: (m, w) the fragment cut, followed by its products and padded with -1.
        cuts_of: (n, 2) for each fragment the cut that divides it and the cut that made it, or -1.
        codes: (max_k, 2) random numbers. The hash of a production is the sum of its parent's first number and its
            children's second numbers, so it does not depend on the order of the children.
    """

    members: Ints
    cuts_of: Ints
    codes: Ints

    @staticmethod
    def of(corpus: Corpus, max_k: int, rng: np.random.Generator) -> "CutArrays":
        """The cuts of `corpus`, for up to `max_k` types."""
        members = np.full((len(corpus.cuts), 1 + max(len(products) for _, products in corpus.cuts)), -1, dtype=np.int64)
        cuts_of = np.full((len(corpus.trials), 2), -1, dtype=np.int64)
        for i, (cut, products) in enumerate(corpus.cuts):
            members[i, : 1 + len(products)] = cut, *products
            cuts_of[cut, 0] = i
            cuts_of[list(products), 1] = i
        return CutArrays(members, cuts_of, rng.integers(-(2**62), 2**62, size=(max_k, 2)))


@dataclass(frozen=True, eq=False)
class Clustering:
    """The result of one run of the clustering.

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


def cluster(features: Floats, cuts: CutArrays, k: int, variance: float, rng: np.random.Generator) -> Clustering:
    """Run the clustering once from a random start (k-means++).

    Args:
        features: (n, d) standardised features.
        cuts: cuts of the same fragments.
        k: number of types, at most the number of distinct features.
        variance: sigma^2.
        rng: random stream.
    """
    means = _seed(features, k, rng.random(k))
    types = nearest_types(features, means)
    _alternate(features, types, k, variance, 0.0, cuts.members, cuts.cuts_of, cuts.codes)
    means = _alternate(features, types, k, variance, 1.0, cuts.members, cuts.cuts_of, cuts.codes)
    return Clustering(types, means, variance)


@njit(cache=True)
def _seed(features, k, draws):  # type: ignore[no-untyped-def]
    """k-means++: sample the means from the fragments by squared distance to the nearest earlier mean."""
    n = len(features)
    means = np.empty((k, features.shape[1]))
    closest = np.full(n, np.inf)
    chosen = int(draws[0] * n)
    for c in range(k):
        means[c] = features[chosen]
        for i in range(n):
            closest[i] = min(closest[i], _squared_distance(features[i], means[c]))
        if c + 1 < k:
            threshold = draws[c + 1] * closest.sum()
            for i in range(n):
                if closest[i] > 0.0:
                    chosen = i
                    threshold -= closest[i]
                    if threshold < 0.0:
                        break
    return means


@njit(cache=True)
def _squared_distance(a, b):  # type: ignore[no-untyped-def]
    total = 0.0
    for j in range(len(a)):
        total += (a[j] - b[j]) ** 2
    return total


@njit(cache=True)
def _distances(means):  # type: ignore[no-untyped-def]
    """(k, k) distances between the means (k, d)."""
    between = np.zeros((len(means), len(means)))
    for a in range(len(means)):
        for b in range(a):
            between[a, b] = between[b, a] = np.sqrt(_squared_distance(means[a], means[b]))
    return between


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
def _alternate(features, types, k, variance, weight, members, cuts_of, codes):  # type: ignore[no-untyped-def]
    """Update `types` in place until no fragment has a better type; return the means.

    `weight` is the weight of the production term: 0 gives plain k-means.
    """
    # Upper bound of the gain from moving one fragment, which is the parent in at most one cut and a child in another.
    max_gain = weight * 3.0 * (np.log(len(members)) + 1.0)
    hashes = _hashes(types, members, codes)
    counts, uses = Dict.empty(int64, int64), np.zeros(k, np.int64)
    for cut in range(len(members)):
        counts[hashes[cut]] = counts.get(hashes[cut], 0) + 1
        uses[types[members[cut, 0]]] += 1
    for _ in range(MAX_SWEEPS):
        means, sizes = _moments(features, types, k)
        between = _distances(means)
        moved = False
        for i in range(len(types)):
            old = types[i]
            if sizes[old] == 1:
                continue
            in_cuts = weight > 0.0 and (cuts_of[i, 0] >= 0 or cuts_of[i, 1] >= 0)
            best, squares = old, _squared_distance(features[i], means[old])
            best_value, distance = -squares / (2.0 * variance), np.sqrt(squares)
            for c in range(k):
                # By the triangle inequality c lies at least so far from the fragment; most types are too far.
                least = max(0.0, between[old, c] - distance)
                if c == old or max_gain - least * least / (2.0 * variance) <= best_value:
                    continue
                value = -_squared_distance(features[i], means[c]) / (2.0 * variance)
                if value + max_gain <= best_value:
                    continue
                if in_cuts:
                    value += weight * _move(i, old, c, cuts_of, codes, hashes, counts, uses)
                    _move(i, c, old, cuts_of, codes, hashes, counts, uses)
                if value > best_value + 1e-9:
                    best, best_value = c, value
            if best != old:
                moved = True
                types[i] = best
                sizes[old] -= 1
                sizes[best] += 1
                if in_cuts:
                    _move(i, old, best, cuts_of, codes, hashes, counts, uses)
        if not moved:
            break
    return _moments(features, types, k)[0]


@njit(cache=True)
def _move(i, old, new, cuts_of, codes, hashes, counts, uses):  # type: ignore[no-untyped-def]
    """Count fragment i as `new` instead of `old`; return by how much the log probability of all productions rises.

    `hashes` (m,) of the cuts' productions, `counts` of each hash and `uses` (k,) of each parent are updated.
    """
    gain = 0.0
    for role in range(2):
        cut = cuts_of[i, role]
        if cut >= 0:
            before = counts[hashes[cut]]
            gain += _n_log_n(before - 1) - _n_log_n(before)
            if before == 1:
                del counts[hashes[cut]]
            else:
                counts[hashes[cut]] = before - 1
            hashes[cut] += codes[new, role] - codes[old, role]
            now = counts.get(hashes[cut], 0)
            gain += _n_log_n(now + 1) - _n_log_n(now)
            counts[hashes[cut]] = now + 1
            if role == 0:
                gain += _n_log_n(uses[old]) - _n_log_n(uses[old] - 1)
                uses[old] -= 1
                gain += _n_log_n(uses[new]) - _n_log_n(uses[new] + 1)
                uses[new] += 1
    return gain


@njit(cache=True)
def _n_log_n(n):  # type: ignore[no-untyped-def]
    return n * np.log(n) if n > 0 else 0.0


@njit(cache=True)
def _hashes(types, members, codes):  # type: ignore[no-untyped-def]
    """(m,) the hash of the production of every cut."""
    hashes = np.zeros(len(members), np.int64)
    for cut in range(len(members)):
        hashes[cut] = codes[types[members[cut, 0]], 0]
        for j in range(1, members.shape[1]):
            if members[cut, j] >= 0:
                hashes[cut] += codes[types[members[cut, j]], 1]
    return hashes


@njit(cache=True)
def _log_productions(types, k, members, codes):  # type: ignore[no-untyped-def]
    """Sum over cuts of log p(alpha -> beta) with the frequencies of Eq. (2)."""
    hashes, uses = _hashes(types, members, codes), np.zeros(k)
    for cut in range(len(members)):
        uses[types[members[cut, 0]]] += 1.0
    hashes.sort()
    total, run = 0.0, 0.0
    for cut in range(len(members)):
        run += 1.0
        if cut + 1 == len(members) or hashes[cut + 1] != hashes[cut]:
            total += run * np.log(run)
            run = 0.0
    for c in range(k):
        if uses[c] > 0.0:
            total -= uses[c] * np.log(uses[c])
    return total
