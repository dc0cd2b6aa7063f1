"""Krippendorff's alpha: how far raters agree beyond chance.

K. Krippendorff, "Computing Krippendorff's Alpha-Reliability", 2011, with its ordinal difference, for any number of
raters and missing ratings. 1 is perfect agreement, 0 that of ratings drawn from the same box by chance.
"""

import numpy as np
from numpy.typing import ArrayLike


def ordinal_alpha(counts: ArrayLike) -> float | None:
    """Krippendorff's alpha of ratings on an ordinal scale.

    Args:
        counts: (u, v) number of raters who gave unit u the value v, values in ascending order.

    Returns:
        alpha = 1 - D_o / D_e, at most 1; None where no unit has two ratings, or all ratings are equal.

    Raises:
        ValueError: not a table of counts.
    """
    n_uv = np.asarray(counts, dtype=np.float64)
    if n_uv.ndim != 2 or not np.isfinite(n_uv).all() or (n_uv < 0).any():
        raise ValueError(f"{n_uv.shape} counts: a table of numbers of raters, one row a unit, was expected")
    n_uv = n_uv[n_uv.sum(axis=1) >= 2]  # a unit with a single rating pairs with nothing
    n_v = n_uv.sum(axis=0)
    if (n_v > 0).sum() < 2:
        return None
    pairs = n_uv[:, :, None] * n_uv[:, None, :] - np.eye(len(n_v)) * n_uv[:, None, :]
    coincidences = (pairs / (n_uv.sum(axis=1) - 1.0)[:, None, None]).sum(axis=0)
    below = np.cumsum(n_v)
    i, j = np.meshgrid(np.arange(len(n_v)), np.arange(len(n_v)), indexing="ij")
    low, high = np.minimum(i, j), np.maximum(i, j)
    between = below[high] - below[low] + n_v[low]  # ratings from the lower to the higher value, both included
    differences = (between - (n_v[low] + n_v[high]) / 2.0) ** 2
    observed = float((coincidences * differences).sum())
    expected = float((np.outer(n_v, n_v) * differences).sum()) / (n_v.sum() - 1.0)
    return float(1.0 - observed / expected)
