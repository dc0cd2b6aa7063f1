import re

import numpy as np
import pytest
import trimesh

from cutgrammar.errors import InputError
from cutgrammar.geometry.canonical import covariance
from cutgrammar.geometry.mesh_io.repair import MAX_FACES, MAX_TOLERANCE, food_from
from cutgrammar.geometry.mesh_io.self_intersection import self_intersections
from cutgrammar.geometry.slicing import solid_of


def ball(level=3):
    made = trimesh.creation.icosphere(level, 0.05)
    made.vertices *= [1.0, 0.7, 0.5]
    return np.array(made.vertices), np.array(made.faces)


def read(vertices, faces, unit=None):
    return food_from(np.asarray(vertices, dtype=float), np.asarray(faces), unit)


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


@pytest.mark.parametrize(("unit", "size"), [("mm", 1000.0), ("cm", 100.0), ("m", 1.0), (None, 1.0)])
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
        (two_overlapping_shells, "intersects itself: its 2 shells overlap; .*unite them"),
        (pushed_through, "intersects itself"),
        (with_fin, "is open|more than two faces"),
        (lambda: (np.zeros((3, 3)), np.zeros((0, 3), int)), "is empty"),
        (lambda: (np.ones((3, 3)), [[0, 1, 2]]), "is flat"),
        (lambda: (ball()[0] * 1000, ball()[1]), "would be 100 m long, read in m; .*try --unit mm$"),
        (lambda: (ball()[0] * 10, ball()[1]), "would be 1 m long, .*try --unit cm$"),
        (lambda: (ball()[0] / 1000, ball()[1]), "would be 0.0001 m long, .*scale it to the size of a food"),
    ],
)
def test_a_mesh_that_cannot_be_repaired_is_refused_with_a_reason(make, text):
    with pytest.raises(InputError) as refusal:
        read(*make())
    assert re.search(text, str(refusal.value)), refusal.value
    assert "\n" not in str(refusal.value)


def test_a_wrong_unit_is_refused_and_possible_units_are_named():
    with pytest.raises(InputError, match=r"would be 0.001 m long, read in cm; .*try --unit m$"):
        read(*ball(), "cm")
