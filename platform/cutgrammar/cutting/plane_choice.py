"""Choosing among planes by virtual slicing: how well the two products fit what the goal wants on either side.

A production divides a fragment into children, each of which is to become some of the goal's fragments. For every plane
and every way to lay the children on its two sides:

    score = fit_weight * (mean over the goal's fragments of q) + spread_weight * log p(spreads | types) + log neighbours

q is the IoU with the goal's fragment where a side becomes one, with their union where a side becomes several that lie
together, and otherwise the smaller of the two ratios of the product's volume to theirs. The spreads of a product
that is cut further are compared with those of its type. The neighbours are those of the planes drawn (`planes`), so
that of planes that fit alike a usual one is taken.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cutgrammar.cutting.planes import neighbours
from cutgrammar.cutting.virtual_slicing import Body
from cutgrammar.geometry.arrays import Floats

TILTS = (0.1, 0.1, 0.05, 0.05, 0.025, 0.025)
"""Angles by which the best plane is tilted in turn [rad]."""
REFUSAL = 10.0
"""What a refused plane takes off the score of a plane beside it [nats]."""


@dataclass(frozen=True, eq=False)
class Wanted:
    """What one child of a production is to become.

    Attributes:
        volume: of the goal's fragments grounded below it [m3].
        count: their number.
        body: their shape as one solid; None where it is not known.
        log_spreads: (4,) mean logs of the spreads of the child's type [log m], and their standard deviation; None
            where they do not matter.
    """

    volume: float
    count: int
    body: Body | None = None
    log_spreads: Floats | None = None


@dataclass(frozen=True)
class PlaneWeights:
    """Weights of the terms of a plane's score (see the module), and what of the best plane is adjusted.

    Attributes:
        fit, spread: weights.
        adjust: move every plane along its normal until the volumes fit.
        tilt: tilt the best plane by smaller and smaller angles where that improves its score.
    """

    fit: float
    spread: float
    adjust: bool
    tilt: bool = False


@dataclass(frozen=True, eq=False)
class ChosenPlane:
    """A plane and how it divides a fragment.

    Attributes:
        numbers: (4,) normal and offset [m] in the canonical frame C of the fragment.
        score: of the plane (see the module).
        above: indices of the children on its positive side.
        share: of the fragment's volume on its positive side.
    """

    numbers: Floats
    score: float
    above: tuple[int, ...]
    share: float


def choose_plane(
    body: Body,
    children: Sequence[Wanted],
    drawn: Floats,
    scale: float,
    weights: PlaneWeights,
    refused: Floats | None = None,
) -> ChosenPlane:
    """The plane with the best score.

    Args:
        body: the fragment to cut.
        children: what the children of the production are to become, at least two.
        drawn: (n, 4) planes (n, d / scale) drawn from the mixture, in the canonical frame C of the fragment.
        scale: unit of their offsets [m].
        weights: of the terms.
        refused: (r, 4) planes like `drawn` that were refused; planes near them are taken only if all others are worse
            by far.

    """
    best: ChosenPlane | None = None
    for group in _groups(len(children)):
        sides = tuple(
            _together([children[i] for i in range(len(children)) if (i in group) is inside]) for inside in (True, False)
        )

        def scored(planes: Floats, sides: tuple[Wanted, ...] = sides) -> tuple[Floats, Floats, Floats]:
            return _scored(body, planes, (sides[0], sides[1]), drawn, scale, weights, refused)

        planes, scores, shares = scored(drawn)
        i = int(np.argmax(scores))
        if best is None or scores[i] > best.score:
            best = ChosenPlane(planes[i], float(scores[i]), group, float(shares[i]))
            tilt = scored
    assert best is not None  # there are at least two children
    for angle in TILTS if weights.tilt else ():
        planes, scores, shares = tilt(_tilted(best.numbers, angle, scale))
        i = int(np.argmax(scores))
        if scores[i] > best.score:
            best = ChosenPlane(planes[i], float(scores[i]), best.above, float(shares[i]))
    return best


def _scored(
    body: Body,
    planes: Floats,
    sides: tuple[Wanted, Wanted],
    drawn: Floats,
    scale: float,
    weights: PlaneWeights,
    refused: Floats | None,
) -> tuple[Floats, Floats, Floats]:
    """Planes (n, 4) with adjusted offsets in [m], their scores (n,), and the shares (n,) above them.

    Args:
        body: the fragment to cut.
        planes: (n, 4) planes (n, d / scale).
        sides: what is wanted above and below.
        drawn, scale, weights, refused: as in `choose_plane`.
    """
    above, below = sides
    unit = np.array([1.0, 1.0, 1.0, scale])
    planes = planes * unit
    if weights.adjust:
        share = above.volume / (above.volume + below.volume)
        planes[:, 3] = body.offsets_for(planes[:, :3], np.full(len(planes), share))
    shares = body.shares(planes)
    fits = np.zeros(len(planes))
    scores = np.log(neighbours(planes / unit, drawn) + 1e-12)
    if refused is not None and len(refused):
        scores -= REFUSAL * neighbours(planes / unit, refused)
    for side, positive in ((above, True), (below, False)):
        fits += side.count * _fit(body, planes, positive, side, shares)
        if side.log_spreads is not None and weights.spread > 0.0:
            off = (np.log(body.spreads(planes, positive)) - side.log_spreads[:3]) / side.log_spreads[3]
            scores -= weights.spread * 0.5 * (off**2).sum(axis=1)
    scores += weights.fit * fits / (above.count + below.count)
    return planes, scores, shares


def _tilted(plane: Floats, angle: float, scale: float) -> Floats:
    """(8, 4) planes (n, d / scale) through the same foot point as `plane` (4,) [m], tilted by `angle` [rad]."""
    normal = plane[:3]
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    turns = np.arange(8) * np.pi / 4.0
    ways = np.cos(turns)[:, None] * first + np.sin(turns)[:, None] * second
    normals = np.cos(angle) * normal + np.sin(angle) * ways
    foot = -plane[3] * normal
    return np.column_stack([normals, -(normals @ foot) / scale])


def _fit(body: Body, planes: Floats, positive: bool, side: Wanted, shares: Floats) -> Floats:
    """(n,) q of the module, of the products of planes (n, 4) on one side."""
    if side.body is not None:
        return body.ious(planes, positive, side.body)
    volumes = np.maximum(body.volume * (shares if positive else 1.0 - shares), 1e-300)
    return np.minimum(volumes / side.volume, side.volume / volumes)


def _groups(n: int) -> list[tuple[int, ...]]:
    """All choices of the children on the positive side: at least one of n, and not all."""
    return [group for size in range(1, n) for group in combinations(range(n), size)]


def _together(children: Sequence[Wanted]) -> Wanted:
    if len(children) == 1:
        return children[0]
    return Wanted(sum(child.volume for child in children), sum(child.count for child in children))
