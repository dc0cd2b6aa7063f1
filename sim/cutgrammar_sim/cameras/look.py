"""Takes depth images of the board with two cameras and fuses them into one point cloud in W (IV-D)."""

from collections.abc import Sequence

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.camera import Camera
from cutgrammar.geometry.fragment import Configuration, Mesh
from cutgrammar.perception.vision.fused_cloud import LabelledCloud
from cutgrammar.settings import CameraSettings
from cutgrammar_sim.cameras.camera import BASELINE, BOARD, Image, Mask, two_cameras
from cutgrammar_sim.cameras.noise import STEPS, noisy
from cutgrammar_sim.cameras.renderers import Renderer, renderer

MAX_HEIGHT = 0.25
"""Points higher above the board are left out [m]."""
MIN_HEIGHT = 5e-4
"""Points lower above the board count as the board even without noise [m]."""
DEVIATIONS = 4.0
"""Standard deviations of the noise below which a point counts as the board; about 30 in a million exceed them."""
WINDOW = 3
"""Neighbours of a point are searched for this many pixels around its own."""
MIN_NEIGHBOURS = 12
"""A point with fewer of the 48 possible neighbours is not on a surface but floats between two."""


def look(
    now: Configuration,
    settings: CameraSettings,
    rng: np.random.Generator,
    others: Sequence[Mesh] = (),
    render: Renderer | None = None,
) -> LabelledCloud:
    """The fused cloud of two depth cameras, cropped to the board.

    Since the board is known, points that are no higher above it than the noise are left out. At most
    `settings.n_points` evenly spread points are kept, by a rule without randomness.

    Args:
        now: the true fragments.
        settings: of the cameras.
        rng: the stream of this look's noise; it should not depend on the method.
        others: other bodies in the scene, such as the links of an arm, in W.
        render: the renderer; None takes the one that the settings name.

    Raises:
        TypeError: a fragment is known as a point cloud only.
        InputError: the settings ask for Vulkan and there is no device.
    """
    cameras = two_cameras(settings)
    images = (render or renderer(settings.renderer)).images(cameras, now, others)
    seen = [
        _surface(noisy(image, camera, settings, rng), camera, settings)
        for image, camera in zip(images, cameras, strict=True)
    ]
    points, normals, owners = (np.concatenate(parts) for parts in zip(*seen, strict=True))
    kept = thinned(points, settings.n_points)
    return LabelledCloud(points[kept], normals[kept], owners[kept])


def thinned(points: Floats, max_points: int) -> Ints:
    """Ascending indices of at most `max_points` of the points (n, 3), one in each cell of a fine grid."""
    if len(points) <= max_points:
        return np.arange(len(points))
    fine, coarse = 1e-4, 0.1  # sides of cells [m] with which too many points are kept, and few enough
    kept = np.arange(0)
    for _ in range(16):
        side = np.sqrt(fine * coarse)
        cells = np.floor(points / side).astype(np.int64)
        keys = (cells[:, 0] * 40009 + cells[:, 1]) * 40009 + cells[:, 2]
        chosen = np.unique(keys, return_index=True)[1]
        if len(chosen) > max_points:
            fine = side
        else:
            coarse, kept = side, chosen
    return np.sort(kept)


def _surface(image: Image, camera: Camera, settings: CameraSettings) -> tuple[Floats, Floats, Ints]:
    """Points (n, 3) of an image above the board in W [m], their normals (n, 3) and their owners (n,)."""
    points = camera.X_WC.position + image.depth[..., None] * camera.rays_W
    x, y, z = np.moveaxis(points, -1, 0)
    step = 0.5 / (STEPS * camera.focal * BASELINE) if settings.depth_noise else 0.0
    # A depth error moves the point along its ray.
    height = np.square(image.depth) * (DEVIATIONS * settings.depth_noise + step) * -camera.rays_W[..., 2] + MIN_HEIGHT
    above = (image.depth > 0.0) & (np.abs(x) <= BOARD[0]) & (np.abs(y) <= BOARD[1]) & (z > height) & (z <= MAX_HEIGHT)
    rows, columns = np.nonzero(above)
    normals, neighbours = _normals(points, above, rows, columns, camera)
    on_surface = neighbours >= MIN_NEIGHBOURS
    rows, columns = rows[on_surface], columns[on_surface]
    return points[rows, columns], normals[on_surface], image.owner[rows, columns]


def _normals(points: Floats, above: Mask, rows: Ints, columns: Ints, camera: Camera) -> tuple[Floats, Ints]:
    """Unit normals (n, 3), towards the camera, of planes fitted to each point's neighbours, and their numbers (n,).

    The neighbours of a point are the points of its window that are no farther away than half the window's width.
    """
    steps = np.arange(-WINDOW, WINDOW + 1)
    down, right = (step.ravel() for step in np.meshgrid(steps, steps, indexing="ij"))
    padded = np.pad(above, WINDOW)
    own = points[rows, columns]
    distance = np.linalg.norm(own - camera.X_WC.position, axis=1)
    reach = np.square(1.5 * (WINDOW + 0.5) * distance / camera.focal)
    count, total, square = np.zeros(len(own)), np.zeros((len(own), 3)), np.zeros((len(own), 3, 3))
    for v, u in zip(down, right, strict=True):
        is_above = padded[rows + v + WINDOW, columns + u + WINDOW]
        offset = points[np.clip(rows + v, 0, camera.height - 1), np.clip(columns + u, 0, camera.width - 1)] - own
        near = is_above & (np.einsum("ij,ij->i", offset, offset) <= reach)
        offset[~near] = 0.0
        count += near
        total += offset
        square += offset[:, :, None] * offset[:, None, :]
    mean = total / np.maximum(count, 1.0)[:, None]
    covariance = square / np.maximum(count, 1.0)[:, None, None] - mean[:, :, None] * mean[:, None, :]
    normals = np.linalg.eigh(covariance)[1][:, :, 0]
    away = np.einsum("ij,ij->i", normals, own - camera.X_WC.position) > 0.0
    normals[away] *= -1.0
    return normals, count.astype(np.int64) - 1
