"""Depth noise of a stereo sensor.

The errors are applied in the order of Handa et al. (A benchmark for RGB-D visual odometry, 3D reconstruction and SLAM,
ICRA 2014) after Barron and Malik (Intrinsic scene properties from a single RGB-D image, CVPR 2013), for a sensor with
two imagers, with the parameters of a RealSense D415:

- A pixel measures at a place that is shifted by half a pixel (their standard deviation), interpolated between its
  neighbours: edges become ragged, and points float between two surfaces.
- Disparity has a normal error, so the error of depth grows with the square of the distance (Grunnet-Jepsen et al.,
  Tuning depth cameras for best performance, Intel: it is distance^2 times the error in pixels over focal length times
  baseline). 1 mm at 1 m is 0.033 pixels at 640 pixels of width. Matched windows overlap, so the errors of neighbouring
  pixels are correlated.
- Disparity is quantised to 1/32 pixel (Intel's white paper on subpixel linearity).
- A surface that only one imager sees has no depth: a shadow to the left of every nearer body.
- On a steep surface, the two images of a window differ too much to be matched: no pixel is lost up to 70 degrees, all
  are at 85. At these angles and distances, disparities within a window of 7 pixels differ by about 2 and 5 pixels.
"""

import numpy as np
from scipy import ndimage

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.camera import Camera
from cutgrammar.settings import CameraSettings
from cutgrammar_sim.cameras.camera import BASELINE, Image, Mask

SHIFT = 0.5
"""Standard deviation of the place at which a pixel measures [pixels]."""
CORRELATION = 1.0
"""Standard deviation of the blur that correlates neighbouring errors [pixels]."""
STEPS = 32
"""Steps of disparity in a pixel."""
SLOPES_DEG = (70.0, 85.0)
"""Angles between ray and normal up to which all pixels, and from which none, are matched [degrees]."""


def noisy(image: Image, camera: Camera, settings: CameraSettings, rng: np.random.Generator) -> Image:
    """The image as a stereo sensor measures it; with `depth_noise` 0, the image itself.

    The same random numbers are drawn for every image of one size.
    """
    if settings.depth_noise == 0.0:
        return image
    shift = rng.normal(0.0, SHIFT, (2, camera.height, camera.width))
    error = ndimage.gaussian_filter(rng.normal(size=image.depth.shape), CORRELATION, mode="wrap")
    error *= 2.0 * np.sqrt(np.pi) * CORRELATION * settings.depth_noise
    chance = rng.random(image.depth.shape)

    places = np.indices(image.depth.shape) + shift
    depth = ndimage.map_coordinates(image.depth, places, order=1, mode="nearest")
    rows, columns = (
        np.clip(np.rint(place).astype(np.int64), 0, size - 1)
        for place, size in zip(places, image.depth.shape, strict=True)
    )
    seen = (image.depth > 0.0) & (depth > 0.0) & _seen_by_both(image.depth, camera)
    low, high = np.radians(SLOPES_DEG)
    seen &= chance > (_slope(image.depth, camera) - low) / (high - low)
    inverse = np.divide(1.0, depth, out=np.zeros_like(depth), where=seen)
    step = 1.0 / (STEPS * camera.focal * BASELINE)  # of the inverse depth
    inverse = step * np.rint((inverse + error) / step)
    seen &= inverse > 0.0
    return Image(
        np.divide(1.0, inverse, out=np.zeros_like(depth), where=seen),
        image.owner[rows, columns],
    )


def _seen_by_both(depth: Floats, camera: Camera) -> Mask:
    """Whether the right imager sees the same surface: nothing nearer projects to the same place or left of it."""
    disparity = np.divide(camera.focal * BASELINE, depth, out=np.zeros_like(depth), where=depth > 0.0)
    place = np.arange(camera.width) - disparity
    leftmost = np.minimum.accumulate(place[:, ::-1], axis=1)[:, ::-1]
    seen: Mask = np.ones(depth.shape, dtype=np.bool_)
    seen[:, :-1] = place[:, :-1] < leftmost[:, 1:]
    return seen


def _slope(depth: Floats, camera: Camera) -> Floats:
    """(height, width) angle between ray and surface normal, at an edge that of its flatter side [rad]."""
    rise = []
    for axis in (0, 1):
        step = np.abs(np.diff(depth, axis=axis))
        edge = np.take(step, [0], axis=axis)
        before, after = np.concatenate([edge, step], axis=axis), np.concatenate([step, edge], axis=axis)
        rise.append(np.minimum(before, after))
    footprint = np.where(depth > 0.0, depth, np.inf) / camera.focal
    return np.asarray(np.arctan(np.hypot(*rise) / footprint))
