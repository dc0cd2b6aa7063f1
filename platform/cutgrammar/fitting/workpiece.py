"""A current fragment as the fitting sees it."""

from dataclasses import dataclass

from cutgrammar.fitting.interior_points import interior_points, solid_of_shape
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.pose import Pose


@dataclass(frozen=True, eq=False)
class Workpiece:
    """A current fragment, prepared for virtual cutting.

    Attributes:
        solid: its mesh, or the convex hull of a cloud, in the fragment's frame F.
        X_WC: pose of its canonical frame C in the world frame W.
        X_FC: the same in the fragment's frame F.
        points: (n, 3) evenly spread points inside, in C [m]; every first part of them is evenly spread too.
        volume: [m3].
    """

    solid: Mesh
    X_WC: Pose
    X_FC: Pose
    points: Floats
    volume: float

    @staticmethod
    def of(fragment: Fragment, n_points: int) -> "Workpiece":
        """A fragment with so many points."""
        solid = solid_of_shape(fragment.shape)
        X_FC = canonical_frame(solid)
        return Workpiece(solid, fragment.X_WF @ X_FC, X_FC, interior_points(solid, n_points, X_FC), solid.volume)
