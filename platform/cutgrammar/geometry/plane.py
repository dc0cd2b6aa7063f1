"""The cutting plane of Section III: pi = [n, d] with n.v + d = 0 and |n| = 1."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats, frozen_floats
from cutgrammar.geometry.pose import Pose


@dataclass(frozen=True, eq=False)
class Plane:
    """All points v with normal.v + offset = 0; variable names tell the frame, as in `plane_W`.

    Attributes:
        normal: (3,) unit normal n.
        offset: d [m].
    """

    normal: Floats
    offset: float

    def __post_init__(self) -> None:
        normal = frozen_floats(self.normal, (3,), "normal")
        length = float(np.linalg.norm(normal))
        if not 0.999 < length < 1.001:
            raise ValueError(f"the plane's normal has length {length:.6g}; 1 was expected")
        if not np.isfinite(self.offset):
            raise ValueError("the plane's offset is not finite")
        if abs(length - 1.0) > 1e-15:  # copies of a plane (pickled, stored) stay bit for bit identical
            normal = frozen_floats(normal / length, (3,), "normal")
        object.__setattr__(self, "normal", normal)
        object.__setattr__(self, "offset", float(self.offset))

    def __reduce__(self) -> tuple[Any, ...]:
        return Plane, (self.normal, self.offset)

    @staticmethod
    def through(point: Floats, normal: Floats) -> "Plane":
        """The plane through `point` (3,) [m] perpendicular to `normal` (3,), which may have any nonzero length."""
        unit = np.asarray(normal, dtype=np.float64) / np.linalg.norm(normal)
        return Plane(unit, -float(unit @ point))

    def distances(self, points: Floats) -> Floats:
        """(n,) signed distances of points (n, 3) from the plane [m]; positive on the side that n points to."""
        return np.asarray(points @ self.normal + self.offset)

    def transformed(self, X_BA: Pose) -> "Plane":
        """This plane, given in frame A, expressed in frame B."""
        normal = X_BA.rotate(self.normal)
        return Plane(normal, self.offset - float(normal @ X_BA.position))

    def to_vector(self) -> Floats:
        """(4,) n, d."""
        return np.append(self.normal, self.offset)
