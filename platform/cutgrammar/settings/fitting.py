"""Settings of joint plan fitting, the method `guided`."""

from typing import Literal

from pydantic.dataclasses import dataclass

from cutgrammar.settings.bounds import CHECKED, Count, NonNegative, Positive, Share


@dataclass(frozen=True, config=CHECKED)
class FittingSettings:
    """Fitting all planes of whole plans to the goal's fragments by virtual cutting.

    Attributes:
        structures: where the starting plans come from: parse trees of the learned "grammar", of a grammar with the same
            productions but "uniform" probabilities and types, of one with "shuffled" children; or no learning at all:
            recursive halving ("halve") or peeling ("peel").
        evaluations: changes of plans that are tried in a trial, for each fragment of the goal.
        seconds: time that the fitting of a trial may take, for each fragment of the goal [s]; 0: no limit. With a limit
            results depend on the machine.
        n_starts: starting plans.
        first_share: share of the evaluations that the first plan of a trial gets; the rest is spread over its cuts.
        coarse_points, fine_points: sample points in a small terminal while exploring and while polishing; larger ones
            have more, but no more are compared with the goal.
        max_points: largest number of sample points of a whole plan.
        fine_share: share of the evaluations that polish.
        hot, warm, cold: temperatures at the beginning, where polishing begins, and at the end, in sums of IoU.
        restructuring: share of the changes that concern structure and grounding while exploring.
        fine_restructuring: the same while polishing.
    """

    structures: Literal["grammar", "uniform", "shuffled", "halve", "peel"] = "grammar"
    evaluations: Count = 12000
    seconds: NonNegative = 0.0
    n_starts: Count = 2
    first_share: Share = 0.7
    coarse_points: Count = 120
    fine_points: Count = 400
    max_points: Count = 30000
    fine_share: Share = 0.25
    hot: Positive = 0.1
    warm: Positive = 0.004
    cold: Positive = 0.0003
    restructuring: Share = 0.8
    fine_restructuring: Share = 0.2
