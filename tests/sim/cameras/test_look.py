import numpy as np
import pytest

from cutgrammar.geometry.fragment import Cloud, Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.seeds import stream
from cutgrammar.settings import CameraSettings
from cutgrammar_sim.cameras.camera import BACKGROUND, BOARD, OTHER, Camera, looking_at, two_cameras
from cutgrammar_sim.cameras.look import look, thinned
from cutgrammar_sim.cameras.rays import Rays
from simple_shapes import box_fragment as box

SMALL = CameraSettings(renderer="rays", width=320, height=240, n_points=2000)
EXACT = CameraSettings(renderer="rays", width=320, height=240, n_points=100_000, depth_noise=0.0)


TWO = (box((0.06, 0.04, 0.03), [0.02, -0.06, 0.015]), box((0.05, 0.05, 0.05), [-0.03, 0.05, 0.025]))


def off_surface(sight, now):
    """Distances of every point from the sides of the box that it belongs to, and the side's outward normal."""
    half = np.array([np.abs(fragment.mesh.vertices).max(axis=0) for fragment in now])[sight.owners]
    middle = np.array([fragment.X_WF.position for fragment in now])[sight.owners]
    beyond = np.abs(sight.points - middle) - half
    axis = np.argmax(beyond, axis=1)
    normals = np.eye(3)[axis] * np.sign(np.take_along_axis(sight.points - middle, axis[:, None], axis=1))
    return np.abs(beyond.max(axis=1)), normals


def test_every_pixel_has_the_depth_of_the_first_surface_on_its_ray():
    camera = Camera(looking_at(np.array([0.0, -0.5, 0.5]), np.zeros(3)), 128, 96, 120.0)
    (image,) = Rays().images([camera], (box((0.1, 0.1, 0.1), [0, 0, 0.05]),), [box((0.2, 0.2, 0.01), [1, 0, 0]).mesh])
    points = camera.X_WC.position + image.depth[..., None] * camera.X_WC.rotate(camera.rays())
    shows = image.owner == 0
    assert points[image.owner == BACKGROUND][:, 2] == pytest.approx(0.0, abs=1e-6)
    assert np.isin(image.owner, [BACKGROUND, OTHER, 0]).all()
    assert 300 < shows.sum() < 1000
    on_top = np.isclose(points[shows][:, 2], 0.1, atol=1e-6)
    in_front = np.isclose(points[shows][:, 1], -0.05, atol=1e-6)
    assert (on_top | in_front).all()
    assert on_top.any()
    assert in_front.any()
    assert camera.project(points[shows]) == pytest.approx(np.argwhere(shows)[:, ::-1] + 0.5, abs=1e-3)


def test_both_cameras_see_the_whole_board():
    corners = np.array([[x * BOARD[0], y * BOARD[1], z] for x in (-1, 1) for y in (-1, 1) for z in (0.0, 0.06)])
    for settings in (CameraSettings(), CameraSettings(width=848, height=480), CameraSettings(width=300, height=300)):
        for camera in two_cameras(settings):
            places = camera.project(corners)
            assert (places > 0).all()
            assert (places < [camera.width, camera.height]).all()


def test_without_noise_points_are_on_the_fragments_that_own_them():
    sight = look(TWO, EXACT, stream(0))
    off, normals = off_surface(sight, TWO)
    assert set(sight.owners) == {0, 1}
    assert off.max() < 1e-5
    assert np.median(np.sum(sight.normals * normals, axis=1)) > 0.999
    top = sight.points[:, 2] > 0.0499
    assert 0.9 * 0.05**2 < np.sum(top) * 0.05**2 / np.sum(top) <= 0.05**2
    assert np.ptp(sight.points[top], axis=0)[:2] == pytest.approx([0.05, 0.05], abs=0.004)


def test_the_fused_cloud_has_the_sides_that_either_camera_sees():
    sight = look(TWO, EXACT, stream(0))
    _, normals = off_surface(sight, TWO)
    seen = {tuple(normal) for normal in normals.round().astype(int)}
    assert {(0, 0, 1), (0, 1, 0), (0, -1, 0), (1, 0, 0)} <= seen
    assert (0, 0, -1) not in seen


def test_noise_moves_points_as_the_settings_say_and_no_points_of_the_board_remain():
    sight = look(TWO, SMALL, stream(1))
    own = sight.owners >= 0
    assert own.mean() > 0.97
    off, normals = off_surface(sight, TWO)
    assert 2e-4 < np.median(off[own]) < 1e-3
    assert np.median(np.sum(sight.normals * normals, axis=1)[own]) > 0.95
    assert np.linalg.norm(sight.normals, axis=1) == pytest.approx(1.0)
    assert len(look((), SMALL, stream(1)).points) == 0


def test_the_same_stream_gives_the_same_cloud_and_another_stream_another():
    first, again, other = (look(TWO, SMALL, stream(0, name)) for name in ("a", "a", "b"))
    assert np.array_equal(first.points, again.points)
    assert np.array_equal(first.normals, again.normals)
    assert np.array_equal(first.owners, again.owners)
    assert first.points.shape != other.points.shape or not np.array_equal(first.points, other.points)


def test_points_of_other_bodies_belong_to_no_fragment():
    link = box((0.1, 0.1, 0.2), [0.0, 0.0, 0.1]).mesh
    beside = Mesh(link.vertices + np.array([0.1, 0.0, 0.1]), link.faces)
    sight = look(TWO, EXACT, stream(0), others=[beside])
    assert (sight.owners == OTHER).any()
    assert (np.abs(sight.points[sight.owners == OTHER][:, 0] - 0.1) < 0.051).all()


def test_thinning_keeps_at_most_the_requested_number_of_evenly_spread_points(rng):
    dense, sparse = (
        rng.uniform(0, 0.05, (20000, 3)) * [1, 1, 0],
        rng.uniform(0, 0.05, (5000, 3)) * [1, 1, 0] + [0.1, 0, 0],
    )
    points = np.concatenate([dense, sparse])
    kept = thinned(points, 1000)
    assert 900 < len(kept) <= 1000
    assert (np.diff(kept) > 0).all()
    assert 0.4 < np.mean(kept < len(dense)) < 0.6
    assert np.array_equal(thinned(points, 10**6), np.arange(len(points)))


def test_a_fragment_that_is_a_cloud_cannot_be_looked_at():
    cloud = Fragment(Cloud(np.zeros((1, 3)), np.eye(3)[:1]), Pose.identity())
    with pytest.raises(TypeError, match="only a point cloud"):
        look((cloud,), SMALL, stream(0))
