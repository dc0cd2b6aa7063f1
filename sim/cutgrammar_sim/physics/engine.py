"""SAPIEN, imported without its warning about a missing Vulkan library, and poses and hulls as it takes them.

Physics needs no Vulkan, and for rendering SAPIEN ships the library.
"""

import warnings
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.pose import Pose

with warnings.catch_warnings():
    warnings.filterwarnings("ignore", message="Failed to find system libvulkan")
    import sapien
    from sapien import physx, render

__all__ = ["COOKING_SCALE", "convex_shape", "physx", "render", "sapien", "sapien_pose"]

COOKING_SCALE = 20.0
"""PhysX merges points that are close, so hulls are enlarged by this factor for cooking and scaled back."""


def sapien_pose(X_AB: Pose) -> Any:
    """The pose as a SAPIEN object."""
    numbers = X_AB.to_vector().astype(np.float32)
    return sapien.Pose(p=numbers[:3], q=numbers[3:])


def convex_shape(corners: Floats, material: Any) -> Any:
    """A collision shape: the convex hull of `corners` (n, 3) [m]."""
    scale = np.full(3, 1.0 / COOKING_SCALE, dtype=np.float32)
    vertices = (corners * COOKING_SCALE).astype(np.float32)
    return physx.PhysxCollisionShapeConvexMesh(vertices=vertices, scale=scale, material=material)
