"""A fused point cloud of several fragments from all cameras (IV-D)."""

from dataclasses import dataclass

from cutgrammar.geometry.arrays import Floats, Ints, frozen_floats, frozen_ints


@dataclass(frozen=True, eq=False)
class LabelledCloud:
    """A fused cloud with the true fragment of every point, for training and evaluation.

    Attributes:
        points: (n, 3) points in W, where z = 0 is the top of the board [m].
        normals: (n, 3) outward unit normals in W.
        owners: (n,) index of the fragment that each point belongs to, or a negative number.
    """

    points: Floats
    normals: Floats
    owners: Ints

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen_floats(self.points, (None, 3), "points"))
        object.__setattr__(self, "normals", frozen_floats(self.normals, (len(self.points), 3), "normals"))
        object.__setattr__(self, "owners", frozen_ints(self.owners, (len(self.points),), "owners"))
