"""The scores that come with the package: best-matched IoU (IV-B2) in three forms, and three scores beside it.

One matching, that with the greatest sum of IoU, serves all of them. All but `IOU` divide by the larger number of
fragments, where a fragment without a counterpart counts as the worst pair.
"""

from functools import lru_cache

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.comparison.overlap import Solid
from cutgrammar.geometry.comparison.refinement import refined_iou
from cutgrammar.geometry.comparison.spectrum import frequencies, spectral_distance
from cutgrammar.trials.agreement import agrees
from cutgrammar.trials.scores import Comparison, Score

MAX_CACHED = 512
"""Spectra kept in memory, since one goal is scored for many methods."""


def _refined(comparison: Comparison) -> float:
    return comparison.mean(refined_iou(a, b, iou) for a, b, iou in comparison.pairs)


def _spectral(comparison: Comparison) -> float:
    distances = (spectral_distance(_frequencies(a), _frequencies(b)) for a, b, _ in comparison.pairs)
    return comparison.mean(distances, unmatched=1.0)


def _agreement(comparison: Comparison) -> float:
    return comparison.mean(agrees(a, b) for a, b, _ in comparison.pairs)


@lru_cache(maxsize=MAX_CACHED)
def _frequencies(solid: Solid) -> Floats:
    return frequencies(solid.mesh)


IOU_STRICT = Score(
    "iou_strict",
    "strict IoU",
    "IoU of the best-matched pairs of fragments, summed and divided by the larger number of fragments, so that "
    "stopping early cannot win. This score decides.",
    lambda comparison: comparison.matching.strict,
    position=0,
)
IOU = Score(
    "iou",
    "matched IoU",
    "IoU of the best-matched pairs, averaged over the matched pairs only, as in the paper (IV-B2).",
    lambda comparison: comparison.matching.mean,
    worst=None,
    position=10,
)
IOU_REFINED = Score(
    "iou_refined",
    "refined IoU",
    "Strict IoU of the same pairs after a local search has refined the rotation of each, because the axes of "
    "near-cubes are noise.",
    _refined,
    position=20,
)
SPECTRAL = Score(
    "spectral",
    "spectral distance",
    "Mean distance of the pairs by their Laplace-Beltrami eigenvalues, from 0 (equal) to 1; a fragment "
    "without a counterpart counts as 1.",
    _spectral,
    worst=1.0,
    higher_is_better=False,
    position=30,
)
AGREEMENT = Score(
    "agreement",
    "agreement",
    "Share, of the larger number of fragments, of those with the category of their counterpart in the goal and its "
    "volume within 20 %.",
    _agreement,
    position=40,
)
HUMAN_RATING = Score(
    "human_rating", "human rating", "Blind rating by people, from 1 to 5.", None, worst=None, position=50
)
COMPUTED = (IOU_STRICT, IOU, IOU_REFINED, SPECTRAL, AGREEMENT)
"""Those that are computed from configurations."""
