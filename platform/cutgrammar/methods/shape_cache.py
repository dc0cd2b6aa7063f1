"""What planners compute from a shape, computed once for each shape."""

from collections.abc import Callable

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Cloud, Configuration, Mesh


class ShapeCache:
    """Keeps the vectors of the shapes in the last configurations it was called with, and drops all others.

    Args:
        compute: shape -> vector (d,), such as the shape feature z.
    """

    def __init__(self, compute: Callable[[Mesh | Cloud], Floats]) -> None:
        self._compute = compute
        # Each shape is kept beside its vector, so that no other object gets its id while that is a key.
        self._known: dict[int, tuple[Mesh | Cloud, Floats]] = {}

    def __call__(self, *configurations: Configuration) -> tuple[Floats, ...]:
        """(n, d) the vectors of the fragments of each configuration."""
        shapes = {id(fragment.shape): fragment.shape for fragments in configurations for fragment in fragments}
        self._known = {key: self._known.get(key) or (shape, self._compute(shape)) for key, shape in shapes.items()}
        return tuple(np.array([self._known[id(f.shape)][1] for f in fragments]) for fragments in configurations)
