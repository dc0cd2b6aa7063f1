"""A fused point cloud of several fragments, as cameras see them together (IV-D)."""

from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints, frozen_floats


@dataclass(frozen=True, eq=False)
class LabelledCloud:
    """A fused cloud of which it is known what each point belongs to: to train with and to measure against.

    Attributes:
        points: (n, 3) in W, whose z = 0 is the board's top [m].
        normals: (n, 3) outward unit normals in W.
        owners: (n,) number of the fragment that each point belongs to, negative for none.
    """

    points: Floats
    normals: Floats
    owners: Ints

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen_floats(self.points, (None, 3), "points"))
        object.__setattr__(self, "normals", frozen_floats(self.normals, (len(self.points), 3), "normals"))
        owners = np.array(self.owners, dtype=np.int64)
        if owners.shape != (len(self.points),):
            raise ValueError(f"owners have shape {owners.shape}; ({len(self.points)},) was expected")
        owners.setflags(write=False)
        object.__setattr__(self, "owners", owners)
