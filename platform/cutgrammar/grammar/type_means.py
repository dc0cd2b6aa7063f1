"""The mean feature of every fragment type: which type a fragment truly has, in the sense of the induction.

Standardising the features moves and scales all of their coordinates alike, so the nearest mean is the same before it.
"""

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints


def type_means(features: Floats, types: Ints, k: int) -> Floats:
    """(k, d) mean of the features (n, d) of each type, from the types (n,) of the training fragments.

    Raises:
        ValueError: a type without fragments.
    """
    sizes = np.bincount(types, minlength=k)
    if sizes.min() == 0:
        raise ValueError(f"type c{int(sizes.argmin())} has no fragment, so no mean")
    totals = np.zeros((k, features.shape[1]))
    np.add.at(totals, types, features)
    return totals / sizes[:, None]


def nearest_types(features: Floats, means: Floats) -> Ints:
    """(n,) the type whose mean (k, d) lies nearest to each of the features (n, d)."""
    return np.asarray(((features[:, None] - means) ** 2).sum(axis=2).argmin(axis=1))
