"""The force with which food resists the blade: fracture toughness times the width that the edge engages, and friction.

A blade that advances by dx through a section of width w creates a cut of area w dx, and each square metre of it takes
the food's fracture toughness R [J/m2]; so the force on the edge is R w [N], whatever the length of the blade. The cut
faces press on both sides of the blade, and friction acts on the area behind the edge that touches the blade.

Sources of the figures of `FRACTURE`, in J/m2:

- Alvarez, Saunders, Vincent, Jeronimidis (2000), An engineering method to evaluate the crisp texture of fruit and
  vegetables, J. Texture Studies 31: 457-473: fracture energies of carrot, celery and apple are 40 to 400. The carrot is
  given the upper end, the apple the middle (its flesh is tougher one way than the other: Khan, Vincent (1993),
  Compressive stiffness and fracture properties of apple and potato parenchyma, J. Texture Studies 24: 423-435).
- Jamdagni, Jia (2019), Robotic cutting of solids based on fracture mechanics and FEM, IROS, as tabulated in the notes
  of the simulator DiSECt: two toughnesses each, 75 and 160 for potato, 125 and 450 for cucumber, of which the higher is
  taken; friction of a knife against potato .6, against cucumber .5. (Whole potatoes that crack under compression take
  1230 to 1350: Schoorl, Holt (1983), Cracking in potatoes, J. Texture Studies 14. A blade needs far less.)
- Kachru, Kotwaliwale, Balasubramanian (1995), Physical and mechanical properties of green banana (Musa paradisiaca)
  fruit, J. Food Engineering 26: 369-378: a slice of banana takes at most 687 or 724 by variety, friction included.

No figure was found for courgette and aubergine, for which the cucumber stands in, as they have a skin like it; nor for
`block` (tofu, cheese, ham), for which the potato does; nor for the pressure on the blade's sides, which is assumed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from cutgrammar.geometry.arrays import Floats, frozen_floats

FRACTURE = MappingProxyType(
    {
        "apple": 220.0,
        "aubergine": 450.0,
        "banana": 724.0,
        "block": 160.0,
        "carrot": 400.0,
        "courgette": 450.0,
        "cucumber": 450.0,
        "potato": 160.0,
    }
)
"""Fracture toughness by food [J/m2]."""

TOUGHEST = max(FRACTURE.values())
"""Fracture toughness assumed for an unknown food [J/m2]."""

FRICTION = 0.6
"""Friction coefficient of a knife's sides against food."""

SIDE_PRESSURE = 2e3
"""Pressure of the cut faces on either side of the blade [Pa]: assumed, so that friction stays below fracture."""

LINES = 200
"""Number of depths at which the width of a section is measured."""


def fracture_toughness(food: str | None, otherwise: float = TOUGHEST) -> float:
    """Fracture toughness of a food by its name [J/m2]; `otherwise` if the food is unknown."""
    return FRACTURE.get(food or "", otherwise)


@dataclass(frozen=True, eq=False)
class Resistance:
    """Resistance to a blade on its way through a section.

    Attributes:
        depths: (k,) positions of the edge along its movement, ascending, from one end of the section to the other [m].
        forces: (k,) against the movement [N].
        middles: (k,) positions along the edge at which the force acts [m].
    """

    depths: Floats
    forces: Floats
    middles: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "depths", frozen_floats(self.depths, (None,), "depths"))
        object.__setattr__(self, "forces", frozen_floats(self.forces, self.depths.shape, "forces"))
        object.__setattr__(self, "middles", frozen_floats(self.middles, self.depths.shape, "middles"))

    def at(self, depth: float) -> tuple[float, float]:
        """The force at a depth of the edge [N], and its position along the edge [m]; no force outside the section."""
        if not self.depths[0] <= depth <= self.depths[-1]:
            return 0.0, 0.0
        place = (depth - self.depths[0]) / (self.depths[-1] - self.depths[0]) * (len(self.depths) - 1)
        low = min(int(place), len(self.depths) - 2)
        share = place - low
        force = (1.0 - share) * self.forces[low] + share * self.forces[low + 1]
        middle = (1.0 - share) * self.middles[low] + share * self.middles[low + 1]
        return float(force), float(middle)


def resistance(
    sections_W: Sequence[Floats], toughness: Sequence[float], across_W: Floats, along_W: Floats, height: float
) -> Resistance:
    """The resistance of the sections of all fragments that are cut at once.

    Args:
        sections_W: for each fragment (m, 2, 3) segments in which the cutting plane meets its surface, in W [m].
        toughness: of each fragment [J/m2].
        across_W: (3,) unit direction of the edge.
        along_W: (3,) unit direction in which the edge moves.
        height: of the blade; food farther behind the edge does not touch its sides [m].

    Returns:
        Depths are measured along `along_W`, middles along `across_W`, both from the origin of W.
    """
    depths = [section @ along_W for section in sections_W]
    widths = [section @ across_W for section in sections_W]
    first, last = min(float(d.min()) for d in depths), max(float(d.max()) for d in depths)
    lines = np.linspace(first, last, LINES)
    engaged = np.array([_chords(w, d, lines) for w, d in zip(widths, depths, strict=True)])  # (fragments, 2, lines)
    width, moment = engaged[:, 0].sum(axis=0), engaged[:, 1].sum(axis=0)
    step = (last - first) / (LINES - 1)
    area = np.concatenate([[0.0], np.cumsum(0.5 * (width[1:] + width[:-1]) * step)])
    beside = area - np.interp(lines - height, lines, area, left=0.0)
    forces = np.asarray(toughness) @ engaged[:, 0] + 2.0 * FRICTION * SIDE_PRESSURE * beside
    centre = float(moment.sum() / max(width.sum(), 1e-12))
    middles = np.where(width > 1e-6, moment / np.maximum(width, 1e-6), centre)
    return Resistance(lines, forces, middles)


def max_resistance(sections_W: Sequence[Floats], toughness: Sequence[float]) -> float:
    """Upper bound of the force on a blade from any direction in the plane [N]; arguments as of `resistance`."""
    total = 0.0
    for section, tough in zip(sections_W, toughness, strict=True):
        points = section[:, 0]
        apart = points[:, None] - points[None]
        lengths = np.linalg.norm(apart, axis=2)
        longest = np.unravel_index(int(np.argmax(lengths)), lengths.shape)
        length = float(lengths[longest])
        across = points - points.mean(axis=0)
        across = across - np.outer(across @ apart[longest], apart[longest]) / max(length, 1e-9) ** 2
        width = 2.0 * float(np.linalg.norm(across, axis=1).max())
        total += tough * length + 2.0 * FRICTION * SIDE_PRESSURE * length * width
    return total


def _chords(w: Floats, d: Floats, lines: Floats) -> Floats:
    """(2, k) length inside a closed outline at each of the depths `lines` (k,), and that length times its middle.

    Args:
        w, d: (m, 2) ends of the outline's segments along the edge and along the movement [m].
        lines: (k,) depths [m]; the outermost are moved slightly inwards, for an outline may begin with a straight side.
    """
    inside = np.clip(lines, d.min() + 1e-9, d.max() - 1e-9)
    shut = (inside < lines - 1e-8) | (inside > lines + 1e-8)
    low, high = d.min(axis=1), d.max(axis=1)
    crossed = (low[None] <= inside[:, None]) & (inside[:, None] < high[None])
    rise = np.where(d[:, 1] != d[:, 0], d[:, 1] - d[:, 0], 1.0)
    at = w[:, 0] + (w[:, 1] - w[:, 0]) * (inside[:, None] - d[:, 0]) / rise
    ends = np.sort(np.where(crossed, at, np.inf), axis=1)
    ends = ends[:, : 2 * int(crossed.sum(axis=1).max() // 2)].reshape(len(lines), -1, 2)
    whole = np.isfinite(ends).all(axis=2)
    ends = np.where(whole[:, :, None], ends, 0.0)
    length = ends[:, :, 1] - ends[:, :, 0]
    chords = np.array([length.sum(axis=1), (length * ends.mean(axis=2)).sum(axis=1)])
    return np.asarray(np.where(shut, 0.0, chords))
