"""Checked, read-only arrays for the frozen values of this package."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def frozen_floats(value: Any, shape: tuple[int | None, ...], name: str) -> Floats:
    """A read-only float64 copy of `value`, which must have `shape` (None: any length) and be finite.

    Raises:
        ValueError: another shape, or a number that is not finite.
    """
    array = np.array(value, dtype=np.float64, order="C")
    if array.ndim != len(shape) or any(s is not None and s != n for s, n in zip(shape, array.shape, strict=True)):
        wanted = "(" + ", ".join("n" if s is None else str(s) for s in shape) + ")"
        raise ValueError(f"{name} has shape {array.shape}; {wanted} was expected")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} holds numbers that are not finite")
    array.setflags(write=False)
    return array


def frozen_faces(value: Any, vertices: int) -> Ints:
    """A read-only (m, 3) int64 copy of triangle corner indices, each below `vertices`.

    Raises:
        ValueError: another shape, or an index out of range.
    """
    array = np.array(value, dtype=np.int64, order="C")
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"faces have shape {array.shape}; (m, 3) was expected")
    if array.size and (array.min() < 0 or array.max() >= vertices):
        raise ValueError(f"faces name vertices outside 0 to {vertices - 1}")
    array.setflags(write=False)
    return array
