"""What a depth camera images, and the two cameras that look at the board (IV-D).

The optics are those of a RealSense D415: it is the D400 camera with the narrower view, which puts more pixels on the
board.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.camera import Camera, looking_at
from cutgrammar.settings import CameraSettings

Mask = NDArray[np.bool_]

BOARD = (0.25, 0.30)
"""Half the extents of the board along x and y of W, about the origin; points beyond it are cropped [m]."""
FOCAL = 0.94
"""Focal length as a share of the image's width: a D415 sees about 56 degrees across at 4:3."""
BASELINE = 0.055
"""Distance between the two imagers of a D415 [m]."""
MAX_DEPTH = 10.0
"""Depth beyond which the image holds no depth [m]."""
POSITIONS = ((0.10, -0.72, 0.60), (0.10, 0.72, 0.60))
"""The pinholes in W [m], on both sides of the board: of a dozen pairs, the one that saw most of the cut surfaces."""

BACKGROUND, OTHER = -1, -2
"""Owner of a pixel that shows the board or nothing, and of one that shows another body, such as a robot's arm."""


@dataclass(frozen=True, eq=False)
class Image:
    """A depth image.

    Attributes:
        depth: (height, width) distance along the optical axis [m]; 0 where nothing was measured.
        owner: (height, width) index of the fragment that a pixel shows; `BACKGROUND`, or `OTHER`.
    """

    depth: Floats
    owner: Ints


@lru_cache(maxsize=4)
def board_depth(camera: Camera) -> Floats:
    """(height, width) depth of the board, the plane z = 0 of W, in each pixel [m]; 0 beyond `MAX_DEPTH`."""
    down = -camera.rays_W[..., 2]
    depth = np.full(down.shape, np.inf)
    np.divide(camera.X_WC.position[2], down, out=depth, where=down > 0.0)
    depth[depth > MAX_DEPTH] = 0.0
    depth.setflags(write=False)
    return depth


@lru_cache(maxsize=2)
def two_cameras(settings: CameraSettings) -> tuple[Camera, Camera]:
    """The two cameras, which look at the middle of the board and see all of it."""
    # What is seen at 4:3 is also seen at any other aspect ratio.
    focal = FOCAL * min(settings.width, settings.height * 4.0 / 3.0)
    first, second = (
        Camera(looking_at(np.array(position), np.zeros(3)), settings.width, settings.height, focal)
        for position in POSITIONS
    )
    return first, second
