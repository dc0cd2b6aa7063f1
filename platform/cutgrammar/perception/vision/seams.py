"""Seams of cuts that the robot did not make, found in the relief of a cloud (IV-D).

Where a fragment has been cut in place, the cameras see a narrow valley along a plane: pixels on the seam look into the
gap. The noise of a single point is as large as such a valley is deep, so whole planes are judged: many directions and
all offsets are tried, and for each the mean relief of the points within `BAND` of the plane is compared with the points
`FLANKS` away on both sides. A plane is a seam if the valley is deep for its number of points, holds few points, and
runs along the whole trace of the plane on the visible surface rather than along a part of it, as a dent would.

Gaps of 2 mm are mostly found, of 1.5 mm every second time, of 1 mm rarely, and closed ones never (docs/decisions.md).
"""

from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.plane import Plane
from cutgrammar.perception.vision.relief import relief

MIN_STRENGTH = 9.0
"""Minimum strength of a seam; the clearest plane of 320 whole foods has 8.7."""
N_HEADINGS, TILTS_DEG = 36, (-20.0, -10.0, 0.0, 10.0, 20.0)
"""Directions of normals that are tried first: headings in half a turn, and tilts from the horizontal [degrees]."""
REFINEMENTS_DEG, N_REFINED = (2.5, 1.2, 0.6), 5
"""Steps by which the best directions are varied then, twice as much in tilt [degrees], and their number."""
N_JUDGED = 12
"""Number of planes whose valley is followed along its trace."""
BIN = 2.5e-4
"""Width of the bins of the points' distances from a plane [m]."""
BAND, FLANKS = 2, (8, 24)
"""Half the width of a valley, and the range of distances of the flanks that it is compared with [bins]."""
MAX_RELIEF = 1.5e-3
"""Larger reliefs count as this, so that few points cannot make a valley [m]."""
MIN_SIDE, MIN_IN_BAND = 0.06, 10
"""Minimum share of points on each side of a seam, and minimum number of points in the valley and in each flank."""
N_SECTIONS, SECTION_QUANTILE = 8, 0.25
"""Sections of a trace, and the quantile of their depths that counts."""
DIP_WEIGHT, TRACE_WEIGHT = 3.0, 4.0
"""Weights in the strength: of the logarithm of the ratio of densities beside and in the valley, and of the quantile of
the depths along the trace [1/mm]."""
MIN_POINTS = 150
"""Minimum number of points of a fragment in which seams are searched."""


@dataclass(frozen=True, eq=False)
class Seam:
    """A plane along which a fragment seems to have been cut.

    Attributes:
        plane_W: the plane.
        strength: how clear its valley is, see `MIN_STRENGTH`.
    """

    plane_W: Plane
    strength: float


def find_seam(points: Floats, normals: Floats) -> Seam | None:
    """The clearest seam in the points (n, 3) of one fragment with normals (n, 3), in W; None if there is none."""
    seam = clearest(points, normals)
    return seam if seam is not None and seam.strength >= MIN_STRENGTH else None


def clearest(points: Floats, normals: Floats) -> Seam | None:
    """The plane that is most like a seam, however weak; None if there are too few points to tell."""
    if len(points) < MIN_POINTS:
        return None
    heights = relief(points, normals)
    known = np.isfinite(heights)
    if known.sum() < MIN_POINTS:
        return None
    points, heights = np.ascontiguousarray(points[known]), np.clip(heights[known], -MAX_RELIEF, MAX_RELIEF)
    directions = _directions()
    best = _valleys(points, heights, directions)
    for step in REFINEMENTS_DEG:
        near = _around(directions[_strongest(best, N_REFINED)], np.radians(step))
        directions = np.concatenate([directions, near])
        best = np.concatenate([best, _valleys(points, heights, near)])
    seams = [
        Seam(plane, float(best[i, 0]) + TRACE_WEIGHT * 1e3 * _depth_along(points, heights, plane))
        for i in _strongest(best, N_JUDGED)
        if np.isfinite(best[i, 0])
        for plane in (Plane(directions[i], -float(best[i, 1])),)
    ]
    return max(seams, key=lambda seam: seam.strength, default=None)


def _strongest(best: Floats, count: int) -> Ints:
    return np.asarray(np.argsort(-best[:, 0], kind="stable")[:count])


def _directions() -> Floats:
    """(d, 3) unit normals."""
    heading = np.repeat(np.arange(N_HEADINGS) * np.pi / N_HEADINGS, len(TILTS_DEG))
    tilt = np.tile(np.radians(TILTS_DEG), N_HEADINGS)
    return np.stack([np.cos(heading) * np.cos(tilt), np.sin(heading) * np.cos(tilt), np.sin(tilt)], axis=1)


def _around(directions: Floats, step: float) -> Floats:
    """(8 d, 3) directions around each of (d, 3)."""
    around = []
    for direction in directions:
        level, rising = _in_plane(direction)
        for i, j in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)):
            moved = direction + step * (i * level + 2.0 * j * rising)
            around.append(moved / np.linalg.norm(moved))
    return np.array(around)


def _in_plane(normal: Floats) -> tuple[Floats, Floats]:
    """A level and a rising unit vector (3,) in the plane of a normal, which is not vertical."""
    level = np.cross(normal, [0.0, 0.0, 1.0])
    level /= np.linalg.norm(level)
    rising = np.cross(level, normal)
    return level, rising if rising[2] > 0.0 else -rising


def _depth_along(points: Floats, heights: Floats, plane: Plane) -> float:
    """Quantile of the valley's depths [m] in sections of the plane's trace with equal numbers of points."""
    distances = np.abs(plane.distances(points))
    near = distances < FLANKS[1] * BIN
    points, heights, distances = points[near], heights[near], distances[near]
    middle = points.mean(axis=0)
    middle[2] = 0.0  # seen from the board, the trace goes around the fragment from one side to the other
    level, rising = _in_plane(plane.normal)
    offsets = points - middle
    angle = np.arctan2((offsets * rising).sum(axis=1), (offsets * level).sum(axis=1))
    depths = []
    for section in np.array_split(np.argsort(angle, kind="stable"), N_SECTIONS):
        inside, beside = distances[section] < 1.5 * BAND * BIN, distances[section] > FLANKS[0] * BIN
        if beside.sum() >= 5:
            valley = heights[section][inside].mean() if inside.any() else -1e-3  # nothing returns from a wide gap
            depths.append(heights[section][beside].mean() - valley)
    return float(np.quantile(depths, SECTION_QUANTILE)) if depths else 0.0


def _valleys(points: Floats, heights: Floats, directions: Floats) -> Floats:
    """(d, 2) the greatest strength without the trace among all planes of each direction, and the plane's n.p [m]."""
    return np.array([_valley(np.einsum("nj,j->n", points, each), heights) for each in directions])


def _valley(along: Floats, heights: Floats) -> tuple[float, float]:
    """The greatest strength among the planes of a direction along which the points have places (n,), and its place."""
    near, far = FLANKS
    lowest, count = float(along.min()), len(along)
    place = ((along - lowest) / BIN).astype(np.int64)
    size = max(int(place.max()) + 2, 2 * far)
    number = np.concatenate([[0.0], np.cumsum(np.bincount(place, minlength=size))])  # of the points below each edge
    total = np.concatenate([[0.0], np.cumsum(np.bincount(place, heights, size))])
    edge = np.arange(far, size - far + 1)

    def between(first: int, last: int) -> tuple[Floats, Floats]:
        """Numbers and mean heights of the points between two edges relative to each edge."""
        n = number[edge + last] - number[edge + first]
        return n, (total[edge + last] - total[edge + first]) / np.maximum(n, 1.0)

    (inside, valley), (before, left), (after, right) = between(-BAND, BAND), between(-far, -near), between(near, far)
    fewest = np.minimum(before, after)
    side = np.minimum(number[edge], count - number[edge])
    dip = fewest / (far - near) / (np.maximum(inside, 1.0) / (2 * BAND))
    strength = 1e3 * (np.minimum(left, right) - valley) * np.sqrt(inside) + DIP_WEIGHT * np.log(np.maximum(dip, 0.3))
    strength[(side < MIN_SIDE * count) | (np.minimum(fewest, inside) < MIN_IN_BAND)] = -np.inf
    best = int(np.argmax(strength))
    return float(strength[best]), lowest + float(edge[best]) * BIN
