"""Shape features of what a planner sees, each shape looked at once while it is there."""

from collections.abc import Callable

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Cloud, Configuration, Mesh


class SeenShapes:
    """Remembers the features of the shapes of the last configurations asked about, and forgets the others."""

    def __init__(self, features: Callable[[Mesh | Cloud], Floats]) -> None:
        self._features = features
        self._seen: dict[int, tuple[Mesh | Cloud, Floats]] = {}

    def __call__(self, *configurations: Configuration) -> tuple[Floats, ...]:
        """(n, 17) features of the fragments of each configuration."""
        there = {id(fragment.shape): fragment.shape for fragments in configurations for fragment in fragments}
        known = self._seen  # a shape is kept beside its feature, so that its id is not used anew
        self._seen = {key: known[key] if key in known else (s, self._features(s)) for key, s in there.items()}
        return tuple(np.array([self._seen[id(f.shape)][1] for f in fragments]) for fragments in configurations)
