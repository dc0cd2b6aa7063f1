import os
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from PIL import Image

from cutgrammar.errors import InputError
from cutgrammar.events import CutMade, Planned
from cutgrammar.geometry.camera import Camera, looking_at
from cutgrammar.geometry.fragment import Cloud, Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import slice_mesh
from cutgrammar.interfaces import Cut
from cutgrammar.motion import Link
from cutgrammar.seeds import stream
from cutgrammar_dashboards.film.film_files import SUFFIXES, write_film
from cutgrammar_dashboards.film.frames import FilmSettings, film_frames, fragments_at
from cutgrammar_dashboards.film.painters import in_turn
from cutgrammar_dashboards.film.stage import FILLED, Stage, close_up
from cutgrammar_dashboards.film.stills import PAPER, Still, _clearest, _Moment, on_one_sheet, stills
from cutgrammar_dashboards.rendering.body import body_of_mesh
from cutgrammar_dashboards.rendering.food_colours import SKIN_AND_FLESH, face_colours, foods_after, largest_facet
from cutgrammar_dashboards.rendering.painting import paint
from cutgrammar_sim.foods import carrot, potato

SMALL = FilmSettings(width=96, height=72, rate=5.0, max_seconds=2.0)


def lying(mesh, y=0.0):
    return Fragment(mesh, Pose(np.eye(3), [0.0, y, -mesh.vertices[:, 2].min()]))


def halves(fragment, x=0.0, apart=0.004):
    sliced = slice_mesh(fragment.mesh, Plane(np.array([1.0, 0.0, 0.0]), -x))
    shift = {1: 0.5 * apart, -1: -0.5 * apart}
    return tuple(
        Fragment(mesh, Pose(np.eye(3), fragment.X_WF.position + np.array([shift[side], 0.0, 0.0])))
        for side, meshes in ((1, sliced.above), (-1, sliced.below))
        for mesh in meshes
    )


@pytest.fixture(scope="module")
def trial(make_motion):
    """A potato beside a carrot, which an arm cuts in two."""
    start = (lying(carrot(stream(0)), -0.04), lying(potato(stream(1)), 0.04))
    end = (start[1], *halves(start[0]))
    cut = Cut(Plane(np.array([1.0, 0.0, 0.0]), 0.0), start[0].p_WC[None])
    motion = make_motion(start, end, np.zeros(3), hertz=20)
    return start, end, [Planned(1, 0, cut, 0.1), CutMade(1, 2, end, None, motion)]


def test_a_film_shows_start_motion_and_result_within_its_maximum_length(trial):
    start, end, events = trial
    frames = list(film_frames(start, end, events, ("carrot", "potato"), SMALL))
    assert len(frames) == 5 + 2 * 5 + 5
    assert all(frame.shape == (72, 96, 3) and frame.dtype == np.uint8 for frame in frames)
    assert np.array_equal(frames[0], frames[4])
    moved = [np.abs(a.astype(int) - b).sum() for a, b in pairwise(frames[5:])]
    assert np.count_nonzero(moved) >= 10
    again = list(film_frames(start, end, events, ("carrot", "potato"), SMALL))
    assert all(np.array_equal(a, b) for a, b in zip(frames, again, strict=True))


@pytest.mark.slow
def test_several_processes_paint_the_same_frames(trial):
    start, end, events = trial
    alone, together = (
        list(film_frames(start, end, events, ("carrot", "potato"), SMALL, processes)) for processes in (1, 3)
    )
    assert len(alone) == len(together)
    assert all(np.array_equal(a, b) for a, b in zip(alone, together, strict=True))


def test_a_painter_that_dies_ends_the_film():
    with pytest.raises(RuntimeError, match="has died"):
        list(in_turn(2, _dies, ()))


def _dies(number, among):
    yield np.zeros((2, 2, 3), dtype=np.uint8)
    os._exit(3)


def test_a_cut_without_an_arm_is_shown_by_its_result_and_goals_that_are_clouds_are_not_shown(trial):
    start, end, _ = trial
    cloud = (Fragment(Cloud(np.zeros((1, 3)), np.eye(3)[:1]), Pose.identity()),)
    without = [CutMade(1, 2, end)]
    frames = list(film_frames(start, cloud, without, (), SMALL))
    assert len(frames) == 3 * 5
    assert not np.array_equal(frames[0], frames[-1])
    beside = list(film_frames(start, end, without, (), SMALL))
    assert np.array_equal(frames[0][24:], beside[0][24:])
    assert not np.array_equal(frames[0], beside[0])


def test_fragments_at_a_sample_have_the_poses_of_its_phase(trial):
    motion = trial[2][-1].motion
    assert fragments_at(motion, 0) == ("transit", motion.phases[0].fragments)
    name, now = fragments_at(motion, len(motion.times) - 1)
    assert name == "settle"
    assert [f.X_WF.to_vector() for f in now] == pytest.approx(motion.phases[-1].poses[-1])
    for phase in motion.phases:
        assert fragments_at(motion, phase.first)[0] == phase.name


def test_stills_end_with_result_and_goal(trial):
    start, end, events = trial
    shown = stills(start, end, events, ("carrot", "potato"), 80, 60)
    assert [one.name for one in shown] == ["initial", "cut 1", "result", "goal"]
    initial, pressed, result, _ = (one.pixels for one in shown)
    assert initial.shape == (60, 80, 3)
    assert not np.array_equal(initial[20:], result[20:])
    assert not np.array_equal(pressed[20:], result[20:])
    assert on_one_sheet(shown).shape == (2 * 60, 2 * 80, 3)
    many = stills(start, end, [CutMade(i, 2, end) for i in range(1, 10)], (), 80, 60)
    assert [one.name for one in many] == ["initial", "cut 1", "cut 3", "cut 5", "cut 7", "cut 9", "result", "goal"]
    assert [one.name for one in stills(start, end, [], (), 80, 60)] == ["initial", "result", "goal"]


def test_stills_show_every_food_in_its_colour_though_cuts_are_left_out(trial, monkeypatch):
    """After two cuts, of which none is shown, the fragments lie where those of the other food were."""
    start = trial[0]
    first = (start[1], *halves(start[0]))
    second = (*first[1:], *halves(start[1]))
    away = [Fragment(f.shape, Pose(np.eye(3), f.X_WF.position * [1.0, -1.0, 1.0])) for f in second]
    seen = []
    monkeypatch.setattr(Stage, "_fragment", lambda _, mesh, food: seen.append(food) or Stage((), ())._board)
    stills(start, second, [CutMade(1, 2, first), CutMade(2, 2, tuple(away))], ("carrot", "potato"), 8, 6, max_cuts=0)
    assert seen[-4:] == ["carrot", "carrot", "potato", "potato"]
    assert seen[:4] == ["carrot", "carrot", "potato", "potato"]


def test_a_sheet_has_its_empty_place_before_the_result(trial):
    pictures = [Still(name, np.full((6, 8, 3), i, dtype=np.uint8)) for i, name in enumerate("abcde", start=1)]
    sheet = on_one_sheet(pictures)
    assert sheet[::6, ::8, 0].tolist() == [[1, 2], [3, PAPER], [4, 5]]


def test_fragments_fill_a_close_up_from_every_side(trial):
    for fragments in (trial[0], trial[0][:1], trial[1][1:]):
        for angle in np.linspace(0.0, 2.0 * np.pi, 7):
            towards = np.array([np.cos(angle), np.sin(angle), 0.7])
            camera = close_up(fragments, 640, 480, towards)
            seen = np.concatenate([camera.project(f.X_WF.apply(f.mesh.vertices)) for f in fragments])
            off = np.abs(seen / [640, 480] - 0.5).max(axis=0)
            assert off.max() == pytest.approx(0.5 * FILLED, abs=1e-9)


def test_the_camera_of_stills_looks_past_the_arm_at_food_and_blade():
    """A wide wall behind the food and a blade in the food: seen from behind the wall, neither is visible."""
    food = lying(potato(stream(1)))

    def part(name, size, place):
        box = trimesh.creation.box(size)
        return Link(name, Mesh(box.vertices, box.faces)), Pose(np.eye(3), place)

    wall = part("wall", (0.02, 0.6, 0.6), [0.1, 0.0, 0.3])
    blade = part("blade", (0.002, 0.2, 0.05), [0.0, 0.0, 0.05])
    now = halves(food)
    towards = _clearest((food,), [_Moment("cut 1", now, [wall, blade])])
    assert towards[0] < -0.1
    stage = Stage((food,), ())
    camera = close_up(now, 64, 48, towards)
    fragments, parts = stage.seen(camera, now, [wall, blade])
    assert fragments.sum() > 0.4 * stage.seen(camera, now, ())[0].sum()
    assert parts[1] > 20


def test_a_cut_exposes_flesh_and_leaves_the_skin():
    whole = lying(carrot(stream(3)))
    largest = largest_facet((whole,))
    skin, flesh = (np.array(colour) for colour in SKIN_AND_FLESH["carrot"])
    assert (face_colours(whole.mesh, "carrot", largest) == skin).all()
    for half in halves(whole):
        colours = face_colours(half.mesh, "carrot", largest)
        bare = (colours == flesh).all(axis=1)
        corners = half.mesh.triangles
        at_cut = np.abs(corners[:, :, 0]).max(axis=1) < 1e-6
        assert np.array_equal(bare, at_cut)
        assert bare.any()
        assert (colours[~bare] == skin).all()


def test_products_have_the_food_of_the_fragment_that_was_cut_and_others_keep_theirs():
    before = (lying(carrot(stream(0)), -0.05), lying(potato(stream(1)), 0.05))
    after = (before[1], *halves(before[0]))
    assert foods_after(before, ("carrot", "potato"), after) == ("potato", "carrot", "carrot")
    assert foods_after(before, ("carrot", "carrot"), after) == ("carrot",) * 3
    moved = tuple(Fragment(Mesh(f.mesh.vertices, f.mesh.faces), Pose(np.eye(3), [0, 0, 1])) for f in after)
    assert foods_after(after, ("potato", "carrot", "carrot"), moved[::-1]) == ("carrot", "carrot", "potato")


def test_surfaces_that_face_the_lamp_are_lighter_and_those_in_shadow_darker():
    shape = trimesh.creation.box((0.1, 0.1, 0.1))
    box = body_of_mesh(Mesh(shape.vertices, shape.faces), np.array([0.6, 0.6, 0.6]), 0.0)
    camera = Camera(looking_at(np.array([0.0, -0.6, 0.6]), np.zeros(3)), 128, 96, 100.0)
    picture = paint(camera, [box])[..., 1].astype(int)

    def at(*p_W):
        column, row = camera.project(np.array([p_W]))[0].astype(int)
        return picture[row, column]

    assert at(0.0, 0.0, 0.05) > at(0.0, -0.05, 0.0) + 10
    assert at(-0.07, 0.06, -0.05) < at(0.2, -0.1, -0.05) - 30
    assert np.array_equal(paint(camera, []), paint(camera, []))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_film_is_written_and_read_back(suffix, tmp_path, rng):
    frames = [np.full((24, 32, 3), 20 * i, dtype=np.uint8) for i in range(1, 5)]
    path = tmp_path / f"film{suffix}"
    write_film(path, iter(frames), 10.0)
    with Image.open(path) as film:
        assert film.n_frames == 4
        for i, frame in enumerate(frames):
            film.seek(i)
            film.load()
            assert film.info["duration"] == pytest.approx(100)
            assert np.abs(np.asarray(film.convert("RGB")).astype(int) - frame).max() <= 6


def test_a_film_that_cannot_be_written_is_an_input_error_with_the_reason(tmp_path):
    frame = np.zeros((24, 32, 3), dtype=np.uint8)
    with pytest.raises(InputError, match=r"suffix of a film '.mp4' is unknown; known: .webp, .gif, .png"):
        write_film(tmp_path / "film.mp4", [frame], 10.0)
    with pytest.raises(InputError, match="nothing to show"):
        write_film(tmp_path / "film.gif", [], 10.0)
    with pytest.raises(InputError, match="cannot be written"):
        write_film(tmp_path / "nowhere" / "film.gif", [frame], 10.0)


def test_the_foods_guessed_for_a_goal_do_not_change_those_of_the_fragments(trial):
    start, end, events = trial
    elsewhere = tuple(Fragment(f.shape, Pose(np.eye(3), f.X_WF.position * [1.0, -1.0, 1.0])) for f in end)
    shown = (list(film_frames(start, goal, events, ("carrot", "potato"), SMALL))[-1] for goal in (elsewhere, end))
    first, second = (frame[24:] for frame in shown)  # below the goal
    assert np.array_equal(first, second)


def test_fragments_that_touch_are_told_apart_by_their_seam():
    box = trimesh.creation.box((0.06, 0.04, 0.03))
    whole = lying(Mesh(np.asarray(box.vertices), np.asarray(box.faces)))
    camera = close_up([whole], 96, 72)
    before, after = (
        Stage((whole,), ("",)).picture(camera, now).astype(int).sum(axis=2)
        for now in ((whole,), halves(whole, 0.0, 0.0))
    )
    seam = after < 0.75 * before
    assert 10 < seam.sum() < 150
    assert np.abs(after - before)[~seam].max() < 0.1 * before.max()
