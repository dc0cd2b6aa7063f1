"""Whether a fragment has the category of its counterpart in the goal, and about its volume.

The category follows from the sorted extents of a fragment's box in its canonical frame, by the ratios and the threshold
with which Zingg (1935) classified pebbles. Where neither ratio of neighbouring extents exceeds 3/2, the fragment is a
chunk or cube, which differ only in size; otherwise the larger ratio decides between slice and strip. Of fragments that
the scripted demonstrator cut, this rule recognises .85 of chunks and cubes, .65 of slices and all strips.
"""

import numpy as np

from cutgrammar.geometry.comparison.overlap import Solid

RATIO = 1.5
"""Ratio of neighbouring extents from which a fragment counts as flat or long."""
TOLERANCE = 0.2
"""Largest difference of the volumes, as a share of the goal fragment's."""


def category_of(solid: Solid) -> str:
    """ "compact" (chunks and cubes), "slice" or "strip"."""
    short, middle, long = np.sort(np.ptp(solid.mesh.vertices, axis=0))
    flatness, length = middle / short, long / middle
    if max(flatness, length) < RATIO:
        return "compact"
    return "slice" if flatness >= length else "strip"


def agrees(reached: Solid, goal: Solid) -> bool:
    """Whether the fragment reached has the category of the goal fragment, and its volume within `TOLERANCE`."""
    same_size = abs(reached.volume - goal.volume) <= TOLERANCE * goal.volume
    return same_size and category_of(reached) == category_of(goal)
