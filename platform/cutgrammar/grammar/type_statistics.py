"""What the training fragments of each type tell beyond Eq. (2): their volume, their spread, how often they stay whole.

`grammar` does not use these; `grammar-plus` adds them to the posterior (`inference.attributes`). A type may have a
single training fragment, so standard deviations and shares are drawn towards those of all types: as if each type had
`PSEUDO` further fragments with the pooled variance, and one with the share of all fragments that stay whole.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints, frozen_floats
from cutgrammar.geometry.canonical import covariance
from cutgrammar.geometry.fragment import Cloud, Mesh

PSEUDO = 3.0
"""Number of pseudo-fragments with the pooled variance in each type's variance."""
MIN_STD = 0.05
"""Floor of the standard deviations of log volumes and log spreads."""


@dataclass(frozen=True, eq=False)
class TypeStatistics:
    """Statistics of the training fragments of types 0 to k - 1.

    Attributes:
        log_volume: (k,) mean log volume [log m3].
        log_volume_std: (k,) its standard deviation.
        log_spreads: (k, 3) mean logs of the standard deviations of the enclosed volume along x, y, z of the canonical
            frame [log m].
        log_spreads_std: (k,) their standard deviation about these means, common to the three.
        whole: (k,) probability that a fragment stays whole, between 0 and 1 exclusive.

    Raises:
        ValueError: the arrays do not match, or a standard deviation or probability is out of range.
    """

    log_volume: Floats
    log_volume_std: Floats
    log_spreads: Floats
    log_spreads_std: Floats
    whole: Floats

    def __post_init__(self) -> None:
        k = len(self.log_volume)
        for name in ("log_volume", "log_volume_std", "log_spreads_std", "whole"):
            object.__setattr__(self, name, frozen_floats(getattr(self, name), (k,), name))
        object.__setattr__(self, "log_spreads", frozen_floats(self.log_spreads, (k, 3), "log_spreads"))
        if not (min(self.log_volume_std.min(), self.log_spreads_std.min()) > 0.0):
            raise ValueError("a standard deviation of the type statistics is not positive")
        if not (self.whole.min() > 0.0 and self.whole.max() < 1.0):
            raise ValueError("a probability to stay whole is not between 0 and 1")

    def __reduce__(self) -> tuple[Any, ...]:
        return TypeStatistics, tuple(getattr(self, name) for name in _NAMES)

    def to_json(self) -> dict[str, Any]:
        """The statistics as plain data."""
        return {name: getattr(self, name).tolist() for name in _NAMES}

    @staticmethod
    def from_json(data: Mapping[str, Any]) -> "TypeStatistics":
        """The inverse of `to_json`.

        Raises:
            KeyError, TypeError, ValueError: `data` does not hold such statistics.
        """
        return TypeStatistics(*(np.array(data[name], dtype=np.float64) for name in _NAMES))


_NAMES = ("log_volume", "log_volume_std", "log_spreads", "log_spreads_std", "whole")


def type_statistics(shapes: Sequence[Mesh | Cloud], types: Ints, cut: Sequence[int], k: int) -> TypeStatistics:
    """The statistics of training fragments.

    Args:
        shapes: of the fragments.
        types: (n,) their types, 0 to k - 1.
        cut: indices of the fragments that were cut.
        k: number of types.

    Raises:
        ValueError: a type has no fragments.
    """
    sizes = np.bincount(types, minlength=k).astype(np.float64)
    if sizes.min() == 0.0:
        raise ValueError(f"type c{int(sizes.argmin())} has no fragments, so it has no statistics")
    moments = [(shape.volume, covariance(shape)) for shape in shapes]
    log_volumes = np.log([volume for volume, _ in moments])
    log_sizes = np.array([0.5 * np.log(np.linalg.eigvalsh(second)) for _, second in moments])
    volume, volume_std = _moments(log_volumes[:, None], types, sizes)
    size, size_std = _moments(log_sizes, types, sizes)
    stays = np.ones(len(types))
    stays[list(cut)] = 0.0
    overall = (stays.sum() + 1.0) / (len(stays) + 2.0)
    whole = (np.bincount(types, weights=stays, minlength=k) + overall) / (sizes + 1.0)
    return TypeStatistics(volume[:, 0], volume_std, size, size_std, whole)


def _moments(values: Floats, types: Ints, sizes: Floats) -> tuple[Floats, Floats]:
    """Means (k, d) and standard deviations (k,) of values (n, d) of each type, the latter drawn to the pooled one."""
    k = len(sizes)
    means = np.zeros((k, values.shape[1]))
    np.add.at(means, types, values)
    means /= sizes[:, None]
    squares = ((values - means[types]) ** 2).mean(axis=1)
    pooled = squares.sum() / max(len(values) - k, 1)
    by_type = np.bincount(types, weights=squares, minlength=k)
    variances = (by_type + PSEUDO * pooled) / (np.maximum(sizes - 1.0, 0.0) + PSEUDO)
    return means, np.maximum(np.sqrt(variances), MIN_STD)
