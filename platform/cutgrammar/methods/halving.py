"""The control `halve`: halve the longest fragment across its long axis; it knows the goal's number of fragments alone.

It learns nothing and looks at no shape of the goal. What plans from more than the number of fragments should do better.
"Halve" is meant by length: the plane bisects the fragment's extent along the canonical axis (III-D) on which that
extent is largest. A position by volume would hardly differ for whole foods, and would need a solid.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame, extents
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.interfaces import Cut, Refusal, Stuck
from cutgrammar.methods.method import Method

SHARES = (0.5, 0.45, 0.55, 0.4, 0.6, 0.35, 0.65)
"""Positions along the longest axis, as shares of the extent; those after the first only where all were refused."""
DECIMALS = 9
"""Lengths [m] that are equal to this many decimals count as equal; the fragment that comes first then wins."""


def cut_across(fragment: Fragment, share: float) -> Cut:
    """The cut of `fragment` across its longest canonical axis, at `share` (0 to 1) of its extent along that axis."""
    X_FC = canonical_frame(fragment.shape)
    low, high = extents(fragment.shape, X_FC)
    axis = int(np.argmax(high - low))
    normal: Floats = np.eye(3)[axis]
    return Cut.of_fragment(fragment, Plane(normal, -float(low[axis] + share * (high[axis] - low[axis]))), X_FC)


def length_of(fragment: Fragment) -> float:
    """Largest extent along an axis of the canonical frame [m]."""
    low, high = extents(fragment.shape, canonical_frame(fragment.shape))
    return float((high - low).max())


def halving_cuts(fragments: Sequence[Fragment]) -> Iterator[Cut]:
    """The cuts to try, in order: all fragments in the middle, the longest first, then all at the next of `SHARES`."""
    longest_first = sorted(fragments, key=lambda fragment: -round(length_of(fragment), DECIMALS))
    for share in SHARES:
        for fragment in longest_first:
            yield cut_across(fragment, share)


class HalvePlanner:
    """Halves the longest fragment; after each refusal the next of `halving_cuts` is tried. Nothing is drawn."""

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """The next cut, deterministic; neither goal nor random numbers are used."""
        del goal, rng
        for attempt, cut in enumerate(halving_cuts(now)):
            if attempt == len(refused):
                return cut
        return Stuck(f"all {len(refused)} positions across the {len(now)} fragments were refused")


HALVE = Method(
    "halve",
    lambda _: HalvePlanner(),
    description="the longest fragment, cut across its long axis in the middle; knows the goal's number of fragments",
    kind="control",
    position=2,
    is_deterministic=True,
)
