"""The size of a scan: most formats store numbers without a unit, so that the user states a unit or a real length."""

from collections.abc import Sequence

import numpy as np
import trimesh

from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.mesh_io.units import UNITS

MIN_EXTENT, MAX_EXTENT = 0.01, 0.5
"""Bounds of a food's largest extent [m]."""


def long_side(points: Floats) -> float:
    """Longest side of the smallest box of any orientation around points (n, 3): what a ruler shows as the length."""
    return float(np.max(trimesh.bounds.oriented_bounds(points)[1]))


def checked_scale(
    extents: Sequence[float], unit: str | None, length: float | None = None, longest: float = 0.0
) -> float:
    """Metres for one of the file's numbers.

    Args:
        extents: largest extents of the objects in a file along its axes, in its numbers; only the largest is checked,
            because fragments may be small.
        unit: of the numbers; None: metres.
        length: real length of the longest object [m]; None: the unit counts.
        longest: the long side of that object, in the file's numbers.

    Raises:
        InputError: no food is as large as that; the message says what every unit would make of it.
    """
    extent = max(extents)
    if extent <= 0.0:
        raise InputError("is flat: all its vertices are at one point; a solid is needed")
    scale = UNITS[unit or "m"] if length is None else length / longest
    if MIN_EXTENT <= scale * extent <= MAX_EXTENT:
        return scale
    read = f"read in {unit or 'm'}" if length is None else f"with the length {length:g} m"
    likely = [
        f"--unit {name} would make it {1000.0 * extent * size:.3g} mm"
        for name, size in UNITS.items()
        if MIN_EXTENT <= extent * size <= MAX_EXTENT
    ]
    likely += ["or give its real length, as in --length 180mm"] if likely else ["scale it to the size of a food"]
    raise InputError(
        f"would be {scale * extent:.3g} m long, {read}; foods are {MIN_EXTENT:g} m to {MAX_EXTENT:g} m long; "
        + ", ".join(likely)
    )
