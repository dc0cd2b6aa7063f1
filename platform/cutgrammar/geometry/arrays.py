"""Validated, read-only arrays for the frozen dataclasses of this package."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def frozen_floats(value: Any, shape: tuple[int | None, ...], name: str) -> Floats:
    """A read-only float64 copy of `value`, which must be finite and have this `shape` (None: any length).

    Raises:
        ValueError: the shape differs, or a number is not finite.
    """
    array = np.array(value, dtype=np.float64, order="C")
    if array.ndim != len(shape) or any(s is not None and s != n for s, n in zip(shape, array.shape, strict=True)):
        expected = "(" + ", ".join("n" if s is None else str(s) for s in shape) + ")"
        raise ValueError(f"{name} has shape {array.shape}; {expected} was expected")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} holds numbers that are not finite")
    array.setflags(write=False)
    return array


def frozen_faces(value: Any, n_vertices: int) -> Ints:
    """A read-only (m, 3) int64 copy of the vertex indices of triangles, which must be below `n_vertices`.

    Raises:
        ValueError: the shape differs, or an index is out of range.
    """
    array = np.array(value, dtype=np.int64, order="C")
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"faces have shape {array.shape}; (m, 3) was expected")
    if array.size and (array.min() < 0 or array.max() >= n_vertices):
        raise ValueError(f"faces have vertex indices outside 0 to {n_vertices - 1}")
    array.setflags(write=False)
    return array
