"""Settings of joint plan fitting, the method `guided`."""

from dataclasses import field
from typing import Literal

from pydantic.dataclasses import dataclass

from cutgrammar.settings.bounds import CHECKED, Count, Few, Natural, NonNegative, Positive, Share


@dataclass(frozen=True, config=CHECKED)
class FittingLevel:
    """One annealing of the fitting.

    Attributes:
        points: sample points in a small terminal; larger ones have more.
        compared: sample points of a terminal that are compared with the goal's fragment; 0: only the standard
            deviations of its volume along its principal axes are, which predict the IoU well where it is low.
        share: of the evaluations of a fitting; the last level gets what is left.
        hot: temperature at the beginning, in sums of IoU; at the end it is that of the next level.
        restructuring: share of the changes that concern structure and grounding.
    """

    points: Count
    compared: Natural
    share: Share
    hot: Positive
    restructuring: Share


@dataclass(frozen=True, config=CHECKED)
class FittingSettings:
    """Fitting all planes of whole plans to the goal's fragments by virtual cutting.

    Attributes:
        structures: where the starting plans come from: parse trees of the learned "grammar", of a grammar with the same
            productions but "uniform" probabilities and types, of one with "shuffled" children; or no learning at all:
            recursive halving ("halve") or peeling ("peel").
        evaluations: changes of plans that are tried in a trial, for each fragment of the goal; goals of more than
            16 get more for each, in proportion, but in all at most 50 times this number.
        seconds: time that the fitting of a trial may take, for each fragment of the goal [s]; 0: no limit. With a limit
            results depend on the machine.
        n_starts: starting plans; after each level the better half is kept, and one for the last level.
        first_share: share of the evaluations that the first plan of a trial gets; the rest is spread over its cuts.
        levels: the annealings of a fitting, from coarse to fine.
        renewal: share of the evaluations with which, before the last level, the parts of the plan that fit worst are
            annealed again by themselves.
        renewal_hot: first temperature of these annealings.
        cold: last temperature.
        refit_hot: first temperature when a plan is fitted again after a cut, at the last level's resolution.
        max_points: largest number of sample points of a whole plan.
    """

    structures: Literal["grammar", "uniform", "shuffled", "halve", "peel"] = "grammar"
    evaluations: Count = 12000
    seconds: NonNegative = 0.0
    n_starts: Few = 1
    first_share: Share = 0.85
    levels: tuple[FittingLevel, FittingLevel, FittingLevel] = field(
        default_factory=lambda: (
            FittingLevel(100, 100, 0.3, 0.1, 0.8),
            FittingLevel(150, 150, 0.15, 0.04, 0.8),
            FittingLevel(1000, 1000, 0.1, 0.012, 0.2),
        )
    )
    renewal: Share = 0.45
    renewal_hot: Positive = 0.07
    cold: Positive = 0.0004
    refit_hot: Positive = 0.003
    max_points: Count = 30000
