"""Poses X_AB of frame B in frame A; the inner letters of a product must match (X_AB @ X_BC)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.arrays import Floats, frozen_floats


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid transform: p_A = rotation @ p_B + position.

    Attributes:
        rotation: (3, 3) proper rotation R_AB.
        position: (3,) origin of B in A [m].
    """

    rotation: Floats
    position: Floats

    def __post_init__(self) -> None:
        rotation = frozen_floats(self.rotation, (3, 3), "rotation")
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0:
            raise ValueError("rotation is not a proper rotation matrix")
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "position", frozen_floats(self.position, (3,), "position"))

    def __reduce__(self) -> tuple[Any, ...]:
        return Pose, (self.rotation, self.position)

    @staticmethod
    def identity() -> "Pose":
        """The pose of a frame in itself."""
        return Pose(np.eye(3), np.zeros(3))

    @staticmethod
    def from_vector(vector: Any) -> "Pose":
        """The pose with position x y z [m] and quaternion w x y z, given as (7,).

        Raises:
            ValueError: the vector is not seven finite numbers, or the quaternion is zero.
        """
        seven = frozen_floats(vector, (7,), "pose")
        if np.linalg.norm(seven[3:]) < 1e-9:
            raise ValueError("the quaternion of a pose must not be zero")
        return Pose(Rotation.from_quat(seven[3:], scalar_first=True).as_matrix(), seven[:3])

    def to_vector(self) -> Floats:
        """(7,) position x y z [m] and quaternion w x y z with w >= 0."""
        return self._vector.copy()

    @cached_property
    def _vector(self) -> Floats:
        quaternion = Rotation.from_matrix(self.rotation).as_quat(scalar_first=True, canonical=True)
        return np.concatenate([self.position, quaternion])

    def __matmul__(self, other: "Pose") -> "Pose":
        return Pose(self.rotation @ other.rotation, self.rotation @ other.position + self.position)

    def inverse(self) -> "Pose":
        """X_BA, the pose of A in B."""
        return Pose(self.rotation.T, -self.rotation.T @ self.position)

    def apply(self, points: Floats) -> Floats:
        """Points (n, 3) or (3,) given in frame B, expressed in frame A [m]."""
        return np.asarray(points @ self.rotation.T + self.position)

    def rotate(self, directions: Floats) -> Floats:
        """Directions (n, 3) or (3,) given in frame B, expressed in frame A."""
        return np.asarray(directions @ self.rotation.T)
