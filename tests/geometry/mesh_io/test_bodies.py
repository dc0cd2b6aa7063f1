import re

import numpy as np
import pytest
import trimesh

from cutgrammar.errors import InputError
from cutgrammar.geometry.canonical import covariance
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.mesh_io.bodies import bodies_in, one_body
from cutgrammar.geometry.mesh_io.files import upright
from cutgrammar.geometry.mesh_io.repair import MAX_FACES, MAX_TOLERANCE
from cutgrammar.geometry.mesh_io.self_intersection import self_intersections
from cutgrammar.geometry.mesh_io.sizes import checked_scale
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.slicing import slice_mesh, solid_of


def ball(level=3):
    made = trimesh.creation.icosphere(level, 0.05)
    made.vertices *= [1.0, 0.7, 0.5]
    return np.array(made.vertices), np.array(made.faces)


def bodies(vertices, faces, keep="all"):
    return bodies_in(np.asarray(vertices, dtype=float), np.asarray(faces), keep)


def read(vertices, faces, unit=None):
    body = one_body(bodies(vertices, faces)[0])
    scale = checked_scale([np.ptp(body.vertices, axis=0).max()], unit)
    return upright(Mesh(body.vertices * scale, body.faces))


def combined(first, second):
    return np.concatenate([first[0], second[0]]), np.concatenate([first[1], second[1] + len(first[0])])


def test_a_valid_mesh_is_centred_and_aligned_and_keeps_its_volume(random_pose, lump):
    for _ in range(5):
        read_back = read(lump.moved(random_pose()).vertices, lump.faces)
        assert read_back.volume == pytest.approx(lump.volume, rel=1e-9)
        assert np.abs(read_back.centroid).max() < 1e-12
        moments = covariance(read_back)
        assert np.abs(moments - np.diag(np.diag(moments))).max() < 1e-9 * moments.max()
        assert moments[0, 0] > moments[1, 1] > moments[2, 2]


@pytest.mark.parametrize(("unit", "size"), [("mm", 1000.0), ("cm", 100.0), ("m", 1.0), ("in", 1 / 0.0254), (None, 1.0)])
def test_the_unit_scales_the_numbers(unit, size):
    vertices, faces = ball()
    assert read(vertices * size, faces, unit).volume == pytest.approx(read(vertices, faces).volume, rel=1e-9)


def test_triangles_without_shared_vertices_are_joined_as_stl_files_require():
    vertices, faces = ball()
    soup = vertices[faces].reshape(-1, 3)
    assert len(read(soup, np.arange(len(soup)).reshape(-1, 3)).vertices) == len(vertices)


def test_inside_out_mixed_repeated_and_degenerate_faces_are_repaired():
    vertices, faces = ball()
    whole = read(vertices, faces)
    mixed = faces.copy()
    mixed[::3] = mixed[::3, ::-1]
    repeated = np.concatenate([faces, faces[:40], faces[:40, ::-1]])
    degenerate = np.concatenate([faces, faces[:5, [0, 0, 1]]])
    for broken in (faces[:, ::-1], mixed, repeated, degenerate):
        mended = read(vertices, broken)
        assert mended.volume == pytest.approx(whole.volume, rel=1e-9)
        assert solid_of(mended).volume() > 0


def test_a_small_hole_is_filled():
    vertices, faces = ball()
    around = (faces == faces[0, 0]).any(axis=1)
    for kept in (faces[1:], faces[~around]):
        mended = read(vertices, kept)
        assert solid_of(mended).volume() == pytest.approx(read(vertices, faces).volume, rel=0.01)


def test_unused_vertices_are_ignored_even_if_they_are_far_away_or_not_finite():
    vertices, faces = ball()
    for stray in ([9.0, 9.0, 9.0], [np.nan, 0.0, 0.0]):
        assert read(np.vstack([vertices, stray]), faces).volume > 0


def test_a_large_mesh_is_simplified_within_its_tolerance():
    vertices, faces = ball(5)
    simpler = read(vertices, faces)
    assert len(faces) > 20_000
    assert len(simpler.faces) <= MAX_FACES
    assert not len(self_intersections(simpler))
    inner = np.linalg.norm(simpler.vertices / [0.05, 0.035, 0.025], axis=1) - 1.0
    assert np.abs(inner).max() < 2 * MAX_TOLERANCE / 0.5


def rough(noise):
    """A ball with the noise of a scanner, as a share of its size."""
    vertices, faces = ball(6)
    return vertices + np.random.default_rng(0).normal(0.0, noise * 0.1, vertices.shape), faces


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.002, 0.003])
def test_a_dense_scan_with_noise_is_smoothed_and_simplified_to_the_shape_below_it(noise):
    vertices, faces = rough(noise)
    assert len(faces) > 80_000
    (body,), notes = bodies(vertices, faces)
    assert re.fullmatch(r"noise was smoothed, 81920 faces were simplified to \d+", notes[0])
    assert len(body.faces) <= MAX_FACES
    assert not len(self_intersections(body))
    assert body.volume == pytest.approx(Mesh(*ball(6)).volume, rel=0.03)
    inner = np.linalg.norm(body.vertices / [0.05, 0.035, 0.025], axis=1) - 1.0
    assert np.abs(inner).max() < 2 * MAX_TOLERANCE / 0.5


@pytest.mark.slow
def test_a_scan_that_is_all_noise_is_refused():
    with pytest.raises(
        InputError, match="cannot be simplified to 5000 within 1% of its size, since its surface is too"
    ):
        bodies(*rough(0.006))


def half_open():
    vertices, faces = ball()
    return vertices, faces[vertices[faces].mean(axis=1)[:, 2] < 0.01]


def box_without_a_side():
    made = trimesh.creation.box((0.1, 0.05, 0.04))
    return made.vertices, made.faces[made.face_normals[:, 2] < 0.5]


def with_nan():
    vertices, faces = ball()
    return np.where(np.arange(len(vertices))[:, None] == faces[7, 1], np.nan, vertices), faces


def with_infinity():
    vertices, faces = ball()
    return np.where(np.arange(len(vertices))[:, None] == faces[7, 1], np.inf, vertices), faces


def square_sheet():
    return [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]], [[0, 1, 2], [0, 2, 3]]


def flattened():
    vertices, faces = ball()
    return vertices * [1, 1, 1e-9], faces


def two_balls():
    vertices, faces = ball()
    return combined((vertices, faces), (vertices + np.array([0.2, 0, 0]), faces))


def two_overlapping_shells():
    vertices, faces = ball()
    return combined((vertices, faces), (vertices + np.array([0.04, 0.003, 0.001]), faces))


def pushed_through():
    vertices, faces = ball()
    return np.where(vertices[:, 2:] > 0.022, [0.0, 0.0, -0.06], vertices), faces


def with_fin():
    vertices, faces = ball()
    a, b, _ = faces[0]
    return np.vstack([vertices, [0.06, 0.06, 0.06]]), np.vstack([faces, [[a, b, len(vertices)], [b, a, len(vertices)]]])


def two_ways_inside_each_other():
    vertices, faces = ball()
    return combined((vertices, faces), (vertices / 2, faces))


def hollow():
    vertices, faces = ball()
    return combined((vertices, faces), (vertices / 2, faces[:, ::-1]))


def body_with_leaf():
    leaf = np.array([[0.03, 0, 0.05], [0.05, 0, 0.05], [0.05, 0.02, 0.07], [0.03, 0.02, 0.07]])
    return combined(ball(), (leaf, np.array([[0, 1, 2], [0, 2, 3]])))


def folded(level=2):
    """A ball on which two neighbouring vertices have changed places, one of them a little lower."""
    vertices, faces = ball(level)
    a, b, _ = faces[60]
    lift = 0.004 / 4 ** (level - 2)
    vertices[[a, b]] = (1 + lift) * vertices[b], (1 - lift) * vertices[a]
    return vertices, faces


def with_half_a_fin():
    vertices, faces = ball()
    fin = [[faces[0, 0], faces[0, 1], len(vertices)]]
    return np.vstack([vertices, [0.06, 0.06, 0.06]]), np.vstack([faces, fin])


def touching(n, turn=False):
    """n cubes in a row, each with vertices of its own, as STL files store them; their common faces may differ."""
    found = None
    for i in range(n):
        cube = trimesh.creation.box((0.03, 0.03, 0.03))
        if turn and i % 2:
            cube.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
        part = (cube.vertices + np.array([0.03 * i, 0, 0]), np.array(cube.faces))
        found = part if found is None else combined(found, part)
    return found


def test_a_fin_without_volume_is_dropped():
    mended = read(*with_fin())
    assert mended.volume == pytest.approx(read(*ball()).volume, rel=1e-9)
    assert len(mended.faces) == len(ball()[1])


def test_a_surface_saved_with_two_sides_is_one():
    vertices, faces = ball()
    assert read(vertices, np.vstack([faces, faces[:, ::-1]])).volume == pytest.approx(read(vertices, faces).volume)


@pytest.mark.parametrize("turn", [False, True])
def test_bodies_that_touch_along_a_whole_face_are_separated_whatever_the_order_of_triangles(turn):
    vertices, faces = touching(3, turn)
    rng = np.random.default_rng(0)
    for inverted in (False, True):
        for _ in range(10):
            shuffled = np.array([np.roll(face, rng.integers(3)) for face in rng.permutation(faces)])
            found, _ = bodies(vertices, shuffled[:, ::-1] if inverted else shuffled)
            assert [body.volume for body in found] == pytest.approx([0.03**3] * 3)
            assert sorted(body.centroid[0] for body in found) == pytest.approx([0.0, 0.03, 0.06], abs=1e-9)


def test_eight_cubes_that_fill_a_cube_are_eight_bodies():
    vertices, faces = touching(2)
    for axis in (1, 2):
        vertices, faces = combined((vertices, faces), (vertices + 0.03 * np.eye(3)[axis], faces))
    assert [body.volume for body in bodies(vertices, faces)[0]] == pytest.approx([0.03**3] * 8)


def test_an_inner_shell_that_faces_inwards_is_a_cavity_and_is_cut_with_its_body():
    (body,), notes = bodies(*hollow())
    whole = read(*ball()).volume
    assert body.volume == pytest.approx(whole * 7 / 8)
    assert notes == ("1 inner shell is a cavity",)
    (upper,), (lower,) = (
        slice_mesh(body, Plane(np.array([0.0, 0.0, 1.0]), 0.0)).above,
        slice_mesh(body, Plane(np.array([0.0, 0.0, 1.0]), 0.0)).below,
    )
    assert upper.volume + lower.volume == pytest.approx(body.volume)
    beside = slice_mesh(body, Plane(np.array([1.0, 0.0, 0.0]), -0.03))
    assert [len(beside.above), len(beside.below)] == [1, 1]


@pytest.mark.parametrize("keep", ["closed", "largest"])
def test_what_is_open_beside_a_body_is_left_out_on_request(keep):
    (body,), notes = bodies(*body_with_leaf(), keep)
    assert body.volume == pytest.approx(read(*ball()).volume)
    assert "1 of 2 bodies are open and were left out" in notes


def test_overlapping_bodies_are_united_on_request():
    (body,), _ = bodies(*two_overlapping_shells(), "union")
    one = read(*ball()).volume
    assert one < body.volume < 2 * one


def test_the_largest_body_is_kept_on_request():
    vertices, faces = ball()
    (body,), _ = bodies(*combined((vertices / 2 + 0.2, faces), (vertices, faces)), "largest")
    assert body.volume == pytest.approx(read(*ball()).volume)


def test_dust_is_dropped_and_said():
    vertices, faces = ball()
    dust = (np.array([[0.1, 0, 0], [0.1001, 0, 0], [0.1, 0.0001, 0]]), np.array([[0, 1, 2]]))
    (body,), notes = bodies(*combined((vertices, faces), dust))
    assert body.volume == pytest.approx(read(*ball()).volume)
    assert notes == ("1 specks of under 0.001 of the surface were dropped",)


def test_a_small_fold_in_a_dense_mesh_is_simplified_away():
    vertices, faces = ball(5)
    broken, _ = folded(5)
    assert len(self_intersections(Mesh(broken, faces)))
    (body,), _ = bodies(broken, faces)
    assert not len(self_intersections(body))
    assert body.volume == pytest.approx(Mesh(vertices, faces).volume, rel=0.02)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (half_open, "is open: .* edges have only one face"),
        (box_without_a_side, "is open: 4 edges"),
        (with_nan, "not finite"),
        (with_infinity, "not finite"),
        (square_sheet, "is flat"),
        (flattened, "is flat"),
        (two_balls, "has 2 separate bodies"),
        (two_overlapping_shells, "intersects itself: its 2 shells overlap, .*unite them"),
        (pushed_through, "intersects itself"),
        (two_ways_inside_each_other, "a body within another, around .* faces the same way"),
        (body_with_leaf, r"has 2 bodies, of which 1 is open: that of 2 faces around \(0.04, 0.01, 0.06\) has 4 edges"),
        (folded, r"intersects itself near \(-?0.0\d+, -?0.0\d+, -?0.0\d+\), possibly"),
        (with_half_a_fin, r"is open: 2 edges have only one face, one of them at \(0.0\d+, 0.0\d+, 0.0\d+\)"),
        (lambda: (np.zeros((3, 3)), np.zeros((0, 3), int)), "is empty"),
        (lambda: (np.ones((3, 3)), [[0, 1, 2]]), "is flat"),
        (
            lambda: (ball()[0] * 1000, ball()[1]),
            "would be 100 m long, read in m; .*--unit mm would make it 100 mm, or give",
        ),
        (
            lambda: (ball()[0] * 10, ball()[1]),
            "would be 1 m long, .*--unit cm would make it 10 mm, --unit in would make it 25.4 mm, or give",
        ),
        (lambda: (ball()[0] / 1000, ball()[1]), "would be 0.0001 m long, .*scale it to the size of a food"),
    ],
)
def test_a_mesh_that_cannot_be_repaired_is_refused_with_a_reason(make, text):
    with pytest.raises(InputError) as refusal:
        read(*make())
    assert re.search(text, str(refusal.value)), refusal.value
    assert "\n" not in str(refusal.value)


def test_a_wrong_unit_is_refused_and_possible_units_are_named():
    with pytest.raises(
        InputError, match=r"would be 0.001 m long, read in cm; .*--unit m would make it 100 mm, or give"
    ):
        read(*ball(), "cm")
