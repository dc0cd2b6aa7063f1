"""Depth noise as of a stereo sensor.

The order of what goes wrong is that of Handa et al. (A benchmark for RGB-D visual odometry, 3D reconstruction and SLAM,
ICRA 2014) after Barron and Malik (Intrinsic scene properties from a single RGB-D image, CVPR 2013), for a sensor with
two imagers, with the figures of a RealSense D415:

- A pixel looks half a pixel aside (their standard deviation), interpolated between its neighbours: edges become
  ragged, and what lies between two surfaces floats between them.
- Disparity is off by a normal error, which makes the depth's grow with the square of the distance (Grunnet-Jepsen et
  al., Tuning depth cameras for best performance, Intel: it is distance^2 times the error in pixels over focal length
  times baseline). 1 mm at 1 m is 0.033 pixels at 640 pixels of width. Windows that are matched overlap, so neighbouring
  pixels err together.
- Disparity comes in steps of 1/32 pixel (Intel's white paper on subpixel linearity).
- What one imager sees and the other does not has no depth: a shadow to the left of whatever is nearer.
- Where the surface turns away, the two images of a window differ too much to be matched: none is lost up to 70 degrees
  and all at 85, where a window of 7 pixels holds disparities some 2 and 5 pixels apart at these distances.
"""

import numpy as np
from scipy import ndimage

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.camera import Camera
from cutgrammar.settings import CameraSettings
from cutgrammar_sim.cameras.camera import BASELINE, Image, Mask

ASIDE = 0.5
"""Standard deviation of where a pixel looks [pixels]."""
TOGETHER = 1.0
"""Standard deviation of the blur that neighbouring errors share [pixels]."""
STEPS = 32
"""Of disparity in a pixel."""
SLOPES_DEG = (70.0, 85.0)
"""Angles between ray and normal up to which all and from which none is matched [degrees]."""


def noisy(image: Image, camera: Camera, settings: CameraSettings, rng: np.random.Generator) -> Image:
    """The image as a stereo sensor would give it; without noise (`depth_noise` 0) the image itself.

    The same numbers are drawn for every image of a size, whatever it shows.
    """
    if settings.depth_noise == 0.0:
        return image
    aside = rng.normal(0.0, ASIDE, (2, camera.height, camera.width))
    error = ndimage.gaussian_filter(rng.normal(size=image.depth.shape), TOGETHER, mode="wrap")
    error *= 2.0 * np.sqrt(np.pi) * TOGETHER * settings.depth_noise
    chance = rng.random(image.depth.shape)

    places = np.indices(image.depth.shape) + aside
    depth = ndimage.map_coordinates(image.depth, places, order=1, mode="nearest")
    rows, columns = (
        np.clip(np.rint(place).astype(np.int64), 0, size - 1)
        for place, size in zip(places, image.depth.shape, strict=True)
    )
    seen = (image.depth > 0.0) & (depth > 0.0) & _seen_by_both(image.depth, camera)
    low, high = np.radians(SLOPES_DEG)
    seen &= chance > (_slope(image.depth, camera) - low) / (high - low)
    inverse = np.divide(1.0, depth, out=np.zeros_like(depth), where=seen)
    step = 1.0 / (STEPS * camera.focal * BASELINE)  # of one over depth
    inverse = step * np.rint((inverse + error) / step)
    seen &= inverse > 0.0
    return Image(
        np.divide(1.0, inverse, out=np.zeros_like(depth), where=seen),
        image.owner[rows, columns],
    )


def _seen_by_both(depth: Floats, camera: Camera) -> Mask:
    """Whether what a pixel shows is seen by the right imager too: nothing nearer lands at its place or left of it."""
    disparity = np.divide(camera.focal * BASELINE, depth, out=np.zeros_like(depth), where=depth > 0.0)
    place = np.arange(camera.width) - disparity
    leftmost = np.minimum.accumulate(place[:, ::-1], axis=1)[:, ::-1]
    seen: Mask = np.ones(depth.shape, dtype=np.bool_)
    seen[:, :-1] = place[:, :-1] < leftmost[:, 1:]
    return seen


def _slope(depth: Floats, camera: Camera) -> Floats:
    """(height, width) angle between the ray and the surface's normal, of the flatter side of an edge [rad]."""
    rise = []
    for axis in (0, 1):
        step = np.abs(np.diff(depth, axis=axis))
        edge = np.take(step, [0], axis=axis)
        before, after = np.concatenate([edge, step], axis=axis), np.concatenate([step, edge], axis=axis)
        rise.append(np.minimum(before, after))
    footprint = np.where(depth > 0.0, depth, np.inf) / camera.focal
    return np.asarray(np.arctan(np.hypot(*rise) / footprint))
