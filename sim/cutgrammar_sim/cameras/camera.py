"""A depth camera, what it images, and the two that look at the board (IV-D).

The frame of a camera is C: origin in its pinhole, x right and y down in the image, z into the scene. Figures are those
of a RealSense D415, the D400 camera with the narrower view and so with the more pixels on the board.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.pose import Pose
from cutgrammar.settings import CameraSettings

Mask = NDArray[np.bool_]

BOARD = (0.25, 0.30)
"""Half the extents of the board along x and y of W, about the origin, and so of what a look keeps [m]."""
FOCAL = 0.94
"""Focal length as a share of the image's width: a D415 sees some 56 degrees across at 4:3."""
BASELINE = 0.055
"""Between the two imagers of a D415 [m]."""
FARTHEST = 10.0
"""Depth beyond which nothing is imaged [m]."""
PLACES = ((0.10, -0.72, 0.60), (0.10, 0.72, 0.60))
"""The pinholes in W [m], to both sides of the board: of a dozen pairs the one that saw most of what had been cut."""

BACKGROUND, OTHER = -1, -2
"""Owner of a pixel that shows the board or nothing, and of one that shows what is no fragment, as a robot's arm."""


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

    @cached_property
    def board(self) -> Floats:
        """(height, width) depth of the board, the plane z = 0 of W, in each pixel [m]; 0 beyond `FARTHEST`."""
        down = -self.rays_W[..., 2]
        depth = np.full(down.shape, np.inf)
        np.divide(self.X_WC.position[2], down, out=depth, where=down > 0.0)
        depth[depth > FARTHEST] = 0.0
        depth.setflags(write=False)
        return depth

    def project(self, p_WP: Floats) -> Floats:
        """(n, 2) right and down from the image's corner [pixels] of points (n, 3) before the camera [m]."""
        p_CP = self.X_WC.inverse().apply(p_WP)
        return self.focal * p_CP[:, :2] / p_CP[:, 2:] + np.array([self.width, self.height]) / 2.0


@dataclass(frozen=True, eq=False)
class Image:
    """What a depth camera images.

    Attributes:
        depth: (height, width) distance along the optical axis [m]; 0 where there is none.
        owner: (height, width) index of the fragment that a pixel shows; `BACKGROUND`, or `OTHER`.
    """

    depth: Floats
    owner: Ints


def looking_at(p_WC: Floats, p_WP: Floats) -> Pose:
    """X_WC of a camera at `p_WC` (3,) that looks at `p_WP` (3,) [m], upright in the image."""
    z = np.asarray(p_WP) - np.asarray(p_WC)
    z = z / np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x = x / np.linalg.norm(x)
    return Pose(np.column_stack([x, np.cross(z, x), z]), np.asarray(p_WC))


@lru_cache(maxsize=2)
def two_cameras(settings: CameraSettings) -> tuple[Camera, Camera]:
    """The two cameras, which look at the middle of the board and have all of it in view."""
    # what is seen at 4:3 is seen at any other proportions too
    focal = FOCAL * min(settings.width, settings.height * 4.0 / 3.0)
    first, second = (
        Camera(looking_at(np.array(place), np.zeros(3)), settings.width, settings.height, focal) for place in PLACES
    )
    return first, second
