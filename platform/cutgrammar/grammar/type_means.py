"""The mean feature of every fragment type, which defines the true type of a fragment as in the induction.

Standardisation applies the same shift and scale to all features, so the nearest mean is the same with and without it.
"""

import numpy as np
from scipy.spatial.distance import cdist

from cutgrammar.geometry.arrays import Floats, Ints


def type_means(features: Floats, types: Ints, k: int) -> Floats:
    """(k, d) mean of the features (n, d) of each type, from the types (n,) of the training fragments.

    Raises:
        ValueError: a type has no fragments.
    """
    sizes = np.bincount(types, minlength=k)
    if sizes.min() == 0:
        raise ValueError(f"type c{int(sizes.argmin())} has no fragments, so it has no mean")
    totals = np.zeros((k, features.shape[1]))
    np.add.at(totals, types, features)
    return totals / sizes[:, None]


def nearest_types(features: Floats, means: Floats) -> Ints:
    """(n,) the type with the nearest mean (k, d) for each of the features (n, d)."""
    return np.asarray(cdist(features, means, "sqeuclidean").argmin(axis=1))
