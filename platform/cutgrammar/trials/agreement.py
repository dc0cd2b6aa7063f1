"""Whether a fragment is of the right kind: the same category as its counterpart in the goal, and about as large.

The category is read off the extents of a fragment's box in its canonical frame, sorted, by the ratios and the threshold
with which Zingg (1935) classed pebbles: neither ratio of neighbouring extents over 3/2 makes a chunk or cube, which
only their size tells apart; else the greater of the two ratios decides between slice and strip. Of fragments that the
scripted demonstrator cut as such it calls .85 of chunks and cubes, .65 of slices and all strips by their name.
"""

import numpy as np

from cutgrammar.geometry.comparison.overlap import Solid

RATIO = 1.5
"""Ratio of neighbouring extents from which a fragment counts as flat or long."""
TOLERANCE = 0.2
"""Greatest difference of the volumes, as a share of the goal fragment's."""


def category_of(solid: Solid) -> str:
    """ "compact" (chunks and cubes), "slice" or "strip"."""
    short, middle, long = np.sort(np.ptp(solid.mesh.vertices, axis=0))
    flatness, length = middle / short, long / middle
    if max(flatness, length) < RATIO:
        return "compact"
    return "slice" if flatness >= length else "strip"


def agrees(reached: Solid, goal: Solid) -> bool:
    """The fragment reached has the category of the goal fragment, and its volume but for `TOLERANCE`."""
    same_size = abs(reached.volume - goal.volume) <= TOLERANCE * goal.volume
    return same_size and category_of(reached) == category_of(goal)
