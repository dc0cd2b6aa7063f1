"""How well a trained network reproduces demonstrated planes: held-out likelihood, and first cuts of whole objects.

A plane head that fails on whole objects spoils every trial at its first cut, while its likelihood may look good. So the
share of first cuts is measured that the plane which a planner would take misses by more than `MAX_ANGLE_DEG`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from cutgrammar.cutting.planes import plane_from
from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.nn.cross_validation import Validated
from cutgrammar.nn.mixture import Mixture
from cutgrammar.settings import CuttingSettings, PlaneSettings

T = TypeVar("T")

MAX_ANGLE_DEG = 30.0
"""A plane within this angle of the demonstrated one reproduces it."""


@dataclass(frozen=True)
class PlaneValidation:
    """What was measured of a plane head.

    Attributes:
        losses: held-out negative log density after each epoch [nats], empty where nothing could be held out.
        gaussian_loss: the same for one Gaussian without inputs; None where nothing could be held out.
        missed: share of the training trials' whole objects whose demonstrated first cut is not reproduced; None where
            there is no whole object.
        missed_held_out: the same by networks that were trained on other trials; None where nothing could be held out.
    """

    losses: tuple[float, ...] = ()
    gaussian_loss: float | None = None
    missed: float | None = None
    missed_held_out: float | None = None

    @property
    def loss(self) -> float | None:
        """The held-out loss at the end of the training."""
        return self.losses[-1] if self.losses else None

    def metrics(self, name: str) -> dict[str, float | None]:
        """What was measured for the network called `name`, by the name it has among a model's metrics."""
        return {
            f"{name}_held_out_loss": self.loss,
            f"{name}_held_out_loss_of_one_gaussian": self.gaussian_loss,
            f"{name}_missed_first_cuts": self.missed,
            f"{name}_missed_first_cuts_held_out": self.missed_held_out,
        }


def validate_planes(
    found: Validated[T],
    mixture: Callable[[T, int], Mixture],
    planes: Floats,
    whole: Ints,
    settings: PlaneSettings,
) -> PlaneValidation:
    """Measure a plane head on the demonstrated planes.

    Args:
        found: the network, and summed negative log densities of held-out planes over all flips.
        mixture: (a network, the number of a plane) -> its mixture over that plane, under the first flip.
        planes: (n, 4, 4) the planes (n, d / scale) under each flip of the fragment.
        whole: numbers of the planes that cut whole objects.
        settings: the floor of the standard deviations.
    """
    missed = _share_missed([_misses(mixture(found.fitted, int(row)), planes[row, 0]) for row in whole])
    if not found.folds:
        return PlaneValidation(missed=missed)
    gaussian, misses = 0.0, []
    for (rows, held), network in zip(found.folds, found.networks, strict=True):
        one = one_gaussian(planes[rows].reshape(-1, 4), settings.min_sigma)
        gaussian -= one.log_folded(planes[held].reshape(-1, 4)).sum()
        misses += [_misses(mixture(network, int(row)), planes[row, 0]) for row in np.intersect1d(held, whole)]
    count = planes.shape[0] * planes.shape[1]
    return PlaneValidation(found.losses(count), float(gaussian / count), missed, _share_missed(misses))


def one_gaussian(planes: Floats, min_sigma: float) -> Mixture:
    """The Gaussian that fits the planes (n, 4) and their opposites best, without any input."""
    return Mixture(np.ones(1), np.zeros((1, 4)), np.maximum(np.sqrt((planes**2).mean(axis=0)), min_sigma)[None])


def _misses(mixture: Mixture, plane: Floats) -> bool:
    """Whether the plane that a planner takes from `mixture` is not like `plane` (4,), the demonstrated one."""
    taken = plane_from(mixture, 1.0, np.random.default_rng(0), CuttingSettings().n_draws)
    return bool(abs(float(taken.normal @ plane[:3])) < np.cos(np.radians(MAX_ANGLE_DEG)))


def _share_missed(misses: list[bool]) -> float | None:
    return float(np.mean(misses)) if misses else None
