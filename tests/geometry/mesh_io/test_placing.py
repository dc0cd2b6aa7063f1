from pathlib import Path

import numpy as np
import pytest
import trimesh

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.mesh_io.files import Scan
from cutgrammar.geometry.mesh_io.placing import TO_Z_UP, place
from cutgrammar.geometry.mesh_io.units import metres_of
from cutgrammar.geometry.plane import Plane


def scan(size, at, name="a.stl"):
    made = trimesh.creation.box(size)
    return Scan(Path(name), (Mesh(made.vertices + np.array(at), made.faces),), ())


AT = np.array([1500.0, 200.0, -900.0])


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_planes_and_points_return_to_the_files_frame(up):
    placed = place([scan((100, 40, 30), AT)], [scan((100, 40, 30), AT)], "mm", up=up)
    frame = placed.sources[0].frame
    rng = np.random.default_rng(0)
    inside = AT + rng.uniform(-10, 10, size=(20, 3))
    points_W = frame.X_WS.apply(1e-3 * inside)
    plane_W = Plane.through(points_W[0], rng.normal(size=3))
    plane = frame.plane(plane_W)
    assert plane.distances(inside) == pytest.approx(1e3 * plane_W.distances(points_W), abs=1e-6)
    assert frame.point(points_W[3]) == pytest.approx(inside[3])
    assert frame.point(placed.now[0].p_WC) == pytest.approx(AT)
    corners = placed.now[0].X_WF.apply(placed.now[0].mesh.vertices)
    height = {"x": 0.1, "y": 0.04, "z": 0.03}[up]
    assert [corners[:, 2].min(), corners[:, 2].max()] == pytest.approx([0.0, height], abs=1e-12)
    assert np.linalg.det(TO_Z_UP[up]) == pytest.approx(1.0)
    assert placed.now[0].mesh.volume > 0


def test_glb_files_have_y_up_as_their_standard_says():
    placed = place([scan((0.1, 0.04, 0.03), (0, 0, 0), "a.glb")], [scan((0.1, 0.03, 0.04), (0, 0, 0))])
    assert np.ptp(placed.now[0].mesh.vertices, axis=0) == pytest.approx([0.1, 0.03, 0.04])
    assert np.ptp(placed.goal[0].mesh.vertices, axis=0) == pytest.approx([0.1, 0.03, 0.04])


def test_a_goal_in_place_stays_there_and_one_elsewhere_is_moved():
    now = [scan((0.1, 0.04, 0.03), (5, 5, 5))]
    halves = [scan((0.05, 0.04, 0.03), (5 + x, 5, 5)) for x in (-0.025, 0.025)]
    placed = place(now, halves)
    assert [f.p_WC[0] for f in placed.goal] == pytest.approx([-0.025, 0.025])
    assert placed.notes == ()
    away = place(now, [Scan(h.path, (Mesh(h.bodies[0].vertices + 3.0, h.bodies[0].faces),), ()) for h in halves])
    assert [f.p_WC[0] for f in away.goal] == pytest.approx([-0.025, 0.025])
    assert "was moved to them" in away.notes[0]


def test_the_stated_length_is_that_of_the_longest_side_however_the_object_lies():
    turned = trimesh.creation.box((7, 2, 1))
    turned.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1, 2, 3]))
    there = [Scan(Path("a.stl"), (Mesh(turned.vertices, turned.faces),), ())]
    placed = place(there, there, length=metres_of("180mm"))
    assert placed.sources[0].frame.scale == pytest.approx(0.18 / 7)


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ((0.06, 0.04, 0.03), None),
        ((0.05, 0.02, 0.02), "0.17 times the volume of the current ones, which cutting cannot change"),
        ((0.02, 0.02, 0.02), "0.0667 times the volume of the current ones; cutting changes no volume"),
    ],
)
def test_goals_of_another_volume_are_noted_or_refused(size, message):
    now, goal = [scan((0.1, 0.04, 0.03), (0, 0, 0))], [scan(size, (0, 0, 0)), scan((0.04, 0.04, 0.03), (0, 0, 0))]
    if message is None:
        assert place(now, goal).notes == ()
    elif "which" in message:
        assert message in place(now, goal[:1]).notes[0]
    else:
        with pytest.raises(InputError, match=message):
            place(now, goal[:1])


@pytest.mark.parametrize(("text", "metres"), [("180mm", 0.18), ("7 in", 0.1778), (".2m", 0.2), ("12.5cm", 0.125)])
def test_lengths_are_read_with_their_unit(text, metres):
    assert metres_of(text) == pytest.approx(metres)


@pytest.mark.parametrize("text", ["180", "mm", "-3mm", "0mm", "3 ft", ""])
def test_lengths_without_a_unit_are_refused(text):
    with pytest.raises(ValueError, match="is not a length with its unit"):
        metres_of(text)
