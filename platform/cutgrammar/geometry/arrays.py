"""Validated, read-only arrays for the frozen dataclasses of this package."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


Shape = tuple[int | None, ...]
"""An expected shape; None stands for any length."""


def frozen_floats(value: Any, shape: Shape, name: str) -> Floats:
    """A read-only float64 copy of `value`, which must be finite and have this shape.

    Raises:
        ValueError: the shape differs, or a number is not finite.
    """
    array: Floats = _frozen(value, np.float64, shape, name)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} holds numbers that are not finite")
    return array


def frozen_ints(value: Any, shape: Shape, name: str) -> Ints:
    """A read-only int64 copy of `value`, which must have this shape.

    Raises:
        ValueError: the shape differs.
    """
    array: Ints = _frozen(value, np.int64, shape, name)
    return array


def frozen_faces(value: Any, n_vertices: int) -> Ints:
    """A read-only (m, 3) int64 copy of the vertex indices of triangles, which must be below `n_vertices`.

    Raises:
        ValueError: the shape differs, or an index is out of range.
    """
    faces = frozen_ints(value, (None, 3), "faces")
    if faces.size and (faces.min() < 0 or faces.max() >= n_vertices):
        raise ValueError(f"faces have vertex indices outside 0 to {n_vertices - 1}")
    return faces


def _frozen(value: Any, dtype: type, shape: Shape, name: str) -> Any:
    array: Any = np.array(value, dtype=dtype, order="C")
    if array.ndim != len(shape) or any(s is not None and s != n for s, n in zip(shape, array.shape, strict=True)):
        expected = "(" + ", ".join("n" if s is None else str(s) for s in shape) + ("," if len(shape) == 1 else "") + ")"
        raise ValueError(f"{name} has shape {array.shape}; {expected} was expected")
    array.setflags(write=False)
    return array
