"""A pinhole camera.

Its frame is C: origin in the pinhole, x right and y down in the image, z into the scene.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.pose import Pose


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera.

    Attributes:
        X_WC: its pose.
        width, height: of its images [pixels].
        focal: focal length [pixels]; the optical axis meets the middle of the image.
    """

    X_WC: Pose
    width: int
    height: int
    focal: float

    def rays(self) -> Floats:
        """(height, width, 3) direction in C through the middle of each pixel, with z = 1."""
        u = (np.arange(self.width) + 0.5 - self.width / 2.0) / self.focal
        v = (np.arange(self.height) + 0.5 - self.height / 2.0) / self.focal
        return np.stack([*np.meshgrid(u, v), np.ones((self.height, self.width))], axis=-1)

    @cached_property
    def rays_W(self) -> Floats:
        """The same directions in W."""
        rays_W = self.X_WC.rotate(self.rays())
        rays_W.setflags(write=False)
        return rays_W

    def project(self, p_WP: Floats) -> Floats:
        """(n, 2) right and down from the image's corner [pixels] of points (n, 3) in front of the camera [m]."""
        p_CP = self.X_WC.inverse().apply(p_WP)
        return self.focal * p_CP[:, :2] / p_CP[:, 2:] + np.array([self.width, self.height]) / 2.0


def looking_at(p_WC: Floats, p_WP: Floats) -> Pose:
    """X_WC of a camera at `p_WC` (3,) that looks at `p_WP` (3,) [m], upright in the image."""
    z = np.asarray(p_WP) - np.asarray(p_WC)
    z = z / np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x = x / np.linalg.norm(x)
    return Pose(np.column_stack([x, np.cross(z, x), z]), np.asarray(p_WC))
