import numpy as np
import pytest

from cutgrammar.geometry.pose import Pose
from cutgrammar.seeds import stream
from cutgrammar.settings import CameraSettings
from cutgrammar_sim.cameras.camera import BACKGROUND, BASELINE, Camera, Image
from cutgrammar_sim.cameras.noise import STEPS, noisy

CAMERA = Camera(Pose.identity(), 200, 150, 600.0)
SETTINGS = CameraSettings(depth_noise=1e-3)


def wall(distance):
    return Image(np.full((150, 200), distance), np.full((150, 200), BACKGROUND))


def leaning(angle_deg):
    """A plane through (0, 0, 0.9) whose normal is turned from the optical axis about the image's vertical."""
    rays = CAMERA.rays()
    normal = np.array([np.sin(np.radians(angle_deg)), 0.0, -np.cos(np.radians(angle_deg))])
    return Image(-0.9 * normal[2] / -(rays @ normal), np.zeros((150, 200), dtype=np.int64))


def before_a_wall(size=50, near=0.8, far=1.0):
    """A square in the middle of the image in front of a wall."""
    image = wall(far)
    depth, owner = image.depth.copy(), image.owner.copy()
    middle = (slice(75 - size // 2, 75 + size // 2), slice(100 - size // 2, 100 + size // 2))
    depth[middle], owner[middle] = near, 0
    return Image(depth, owner)


def test_the_error_at_one_metre_is_that_of_the_settings_and_grows_with_the_square_of_the_distance():
    for distance in (0.5, 1.0, 2.0):
        depth = noisy(wall(distance), CAMERA, SETTINGS, stream(0, "wall")).depth
        assert (depth > 0.0).all()
        assert np.std(depth - distance) == pytest.approx(1e-3 * distance**2, rel=0.05)
        assert abs(np.mean(depth - distance)) < 0.1e-3 * distance**2


def test_errors_of_neighbouring_pixels_are_correlated():
    error = noisy(wall(1.0), CAMERA, SETTINGS, stream(0)).depth - 1.0
    assert np.corrcoef(error[:, 1:].ravel(), error[:, :-1].ravel())[0, 1] > 0.5
    assert abs(np.corrcoef(error[:, 8:].ravel(), error[:, :-8].ravel())[0, 1]) < 0.05


def test_disparity_is_quantised():
    depth = noisy(wall(1.0), CAMERA, SETTINGS, stream(0)).depth
    steps = STEPS * CAMERA.focal * BASELINE / depth
    assert np.abs(steps - np.rint(steps)).max() < 1e-6
    assert len(np.unique(depth)) < 20


def test_surfaces_hidden_from_the_right_imager_have_no_depth():
    image = before_a_wall()
    depth = noisy(image, CAMERA, SETTINGS, stream(0)).depth
    shadow = round(CAMERA.focal * BASELINE * (1 / 0.8 - 1 / 1.0))  # pixels, to the left of the square
    assert (depth[60:90, 75 - shadow + 1 : 75] == 0.0).all()
    assert (depth[60:90, 20 : 75 - shadow - 1] > 0.0).all()
    assert (depth[60:90, 127:] > 0.0).all()


def test_at_edges_some_pixels_float_between_the_surfaces():
    depth = noisy(before_a_wall(), CAMERA, SETTINGS, stream(0)).depth
    floating = (depth > 0.81) & (depth < 0.99)
    rows, columns = np.nonzero(floating)
    assert 10 < floating.sum() < 500
    at_edge = np.minimum(
        np.minimum(np.abs(rows - 49.5), np.abs(rows - 99.5)),
        np.minimum(np.abs(columns - 74.5), np.abs(columns - 124.5)),
    )
    assert at_edge.max() < 4.0


def test_steep_surfaces_are_lost():
    kept = [
        (noisy(leaning(angle), CAMERA, SETTINGS, stream(0)).depth[:, 90:110] > 0.0).mean()
        for angle in (0, 60, 74, 78, 86)
    ]
    assert kept[0] == kept[1] == 1.0
    assert 1.0 > kept[2] > kept[3] > kept[4] == 0.0


def test_without_noise_an_image_is_unchanged():
    image = before_a_wall()
    assert noisy(image, CAMERA, CameraSettings(depth_noise=0.0), stream(0)) is image


def test_images_of_one_size_use_the_same_number_of_random_numbers():
    after = []
    for image in (wall(1.0), before_a_wall()):
        rng = stream(0)
        noisy(image, CAMERA, SETTINGS, rng)
        after.append(rng.random())
    assert after[0] == after[1]
