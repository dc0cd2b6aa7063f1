import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import slice_mesh
from cutgrammar.interfaces import Cut, Done, Refused
from cutgrammar.settings import Settings, WorldSettings
from cutgrammar_sim.physics.hulls import MAX_HULL_CORNERS, MAX_PIECE_CORNERS, HullError, hull_pieces
from cutgrammar_sim.physics.section import section
from cutgrammar_sim.worlds.bench import Bench
from cutgrammar_sim.worlds.board import Board
from cutgrammar_sim.worlds.free_knife import Stroke, fan, find_stroke
from cutgrammar_sim.worlds.lying_fragments import LyingFragments, parted
from simple_shapes import as_mesh
from simple_shapes import box_fragment as box

X, Y, Z = np.eye(3)


def board(*start):
    world = Board(WorldSettings())
    world.reset(start)
    return world


def test_a_stack_is_cut_from_the_side_that_is_free():
    lower, upper = box((0.06, 0.03, 0.02), [0, 0, 0.01]), box((0.06, 0.03, 0.02), [0, 0, 0.03])
    stroke = find_stroke((lower, upper), (1,), Plane(X, 0.0))
    assert isinstance(stroke, Stroke)
    assert stroke.along_W == pytest.approx(-Z)
    assert stroke.width == pytest.approx(0.03)
    from_the_side = find_stroke((lower, upper), (0,), Plane(X, 0.0))
    assert isinstance(from_the_side, Stroke)
    assert abs(from_the_side.along_W) == pytest.approx(Y)


def test_a_fragment_enclosed_by_others_cannot_be_cut_without_them():
    size = (0.06, 0.03, 0.02)
    shut_in = box(size, [0, 0, 0.01])
    around = [box(size, [0, 0, 0.0301]), box(size, [0, 0.031, 0.01]), box(size, [0, -0.031, 0.01])]
    world = board(shut_in, *around)
    before = [f.X_WF.to_vector() for f in world.truth()]
    result = world.apply(Cut(Plane(X, 0.0), world.truth()[0].p_WC[None]))
    assert isinstance(result, Refused)
    assert result.reason.startswith("would cut a neighbour")
    assert np.array_equal(before, [f.X_WF.to_vector() for f in world.truth()])
    bench = Bench(1e-3)  # whose blade is object-centric
    bench.reset((shut_in, *around))
    assert bench.apply(Cut(Plane(X, 0.0), shut_in.p_WC[None])) == Done(2)


def test_a_level_plane_is_cut_from_the_side():
    slab = box((0.06, 0.03, 0.02), [0, 0, 0.01])
    stroke = find_stroke((slab,), (0,), Plane(Z, -0.01))
    assert isinstance(stroke, Stroke)
    assert stroke.along_W[2] == 0.0
    world = board(slab)
    assert world.apply(Cut(Plane(Z, -0.01), world.truth()[0].p_WC[None])) == Done(2)
    above, below = world.truth()
    assert above.p_WC[2] == pytest.approx(0.015, abs=5e-4)
    assert below.p_WC[2] == pytest.approx(0.005, abs=5e-4)


@pytest.mark.parametrize("seed", range(20))
def test_a_blade_as_wide_as_the_section_divides_a_fragment_that_lies_alone(seed, lump):
    rng = np.random.default_rng(seed)
    fragment = Fragment(lump, Pose(np.eye(3), [0.0, 0.0, -lump.vertices[:, 2].min()]))
    plane = Plane.through(fragment.p_WC, rng.normal(size=3))
    stroke = find_stroke((fragment,), (0,), plane)
    assert isinstance(stroke, Stroke)
    seen = section(fragment, plane).reshape(-1, 3)
    assert abs(plane.distances(seen)).max() < 1e-12
    assert abs(plane.distances(stroke.p_WE)) < 1e-12
    reach = (seen - stroke.p_WE) @ stroke.along_W
    assert reach.min() > 0.0
    assert reach.max() == pytest.approx(stroke.length)
    assert abs((seen - stroke.p_WE) @ np.cross(plane.normal, stroke.along_W)).max() == pytest.approx(stroke.width / 2)


def leaning(x, lean):
    """A slice whose faces lean over towards x."""
    shape = trimesh.creation.box((0.02, 0.03, 0.04)).apply_translation([x, 0, 0.02])
    return Fragment(Mesh(shape.vertices + np.outer(shape.vertices[:, 2], [lean, 0, 0]), shape.faces), Pose.identity())


def test_the_knife_passes_between_slices_that_lean_on_each_other():
    row = tuple(leaning(0.021 * i, 0.3) for i in range(-2, 3))
    stroke = find_stroke(row, (2,), Plane(Y, 0.0))
    assert isinstance(stroke, Stroke)
    assert abs(np.degrees(np.arctan2(stroke.along_W[0], stroke.along_W[2])) + 163) < 360 / 64
    slab = box((0.2, 0.03, 0.02), [0, 0, 0.06])  # and if something lies on top of them
    assert isinstance(find_stroke((*row, slab), (2,), Plane(Y, 0.0)), Refused)


def test_a_fragment_far_in_front_is_not_in_the_way_of_the_blade():
    low, high = box((0.06, 0.03, 0.02), [0, 0, 0.01]), box((0.06, 0.2, 0.02), [0, 0, 0.3])
    assert find_stroke((low, high), (0,), Plane(X, 0.0)).along_W == pytest.approx(-Z)


def test_a_section_has_the_area_of_the_plane_within_the_mesh(lump):
    plane = Plane.through(lump.centroid, np.array([0.3, -0.5, 0.8]))
    segments = section(Fragment(lump, Pose.identity()), plane)
    cap = trimesh.Trimesh(lump.vertices, lump.faces).section(plane_normal=plane.normal, plane_origin=lump.centroid)
    assert np.linalg.norm(segments[:, 0] - segments[:, 1], axis=1).sum() == pytest.approx(cap.length)


def test_the_fan_lies_in_the_plane_and_begins_downward(rng):
    for normal in (X, Z, -Z, *rng.normal(size=(5, 3))):
        unit = normal / np.linalg.norm(normal)
        directions = np.array(fan(unit))
        assert abs(directions @ unit).max() < 1e-12
        assert (np.diff(directions[:, 2]) > -1e-12).all()


def test_a_turned_scene_is_cut_from_the_same_side(lump):
    turn = Pose(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0.1, -0.2, 0.0]))
    now = tuple(Fragment(lump, Pose(np.eye(3), [0.07 * i, 0.02 * i, 0.06])) for i in range(3))
    plane = Plane.through(now[1].p_WC, np.array([0.2, 0.9, 0.3]))
    stroke = find_stroke(now, (1,), plane)
    turned = find_stroke(tuple(Fragment(f.shape, turn @ f.X_WF) for f in now), (1,), plane.transformed(turn))
    assert turned.along_W == pytest.approx(turn.rotate(stroke.along_W))
    assert turned.p_WE == pytest.approx(turn.apply(stroke.p_WE))


def test_halves_are_parted_by_the_blades_thickness_and_stay_above_the_board():
    slab = box((0.06, 0.03, 0.02), [0, 0, 0.01])
    plane = Plane.through(slab.p_WC, np.array([0.6, 0.0, 0.8]))
    halves = parted(slab, slice_mesh(slab.mesh, plane.transformed(slab.X_WF.inverse())), 0.001 * plane.normal)
    above, below = (plane.distances(half.X_WF.apply(half.mesh.vertices)) for half in halves)
    assert above.min() - below.max() == pytest.approx(0.001)
    assert min(half.X_WF.apply(half.mesh.vertices)[:, 2].min() for half in halves) > -1e-12


def test_a_fragment_that_reaches_under_the_board_is_raised_and_everything_comes_to_rest(lump):
    lying = LyingFragments(WorldSettings())
    lying.lay_out((Fragment(lump, Pose(np.eye(3), [0.0, 0.0, -0.01])), box((0.03, 0.03, 0.03), [0.1, 0, 0.05])))
    assert lying.settle()
    lowest = [f.X_WF.apply(f.mesh.vertices)[:, 2].min() for f in lying.now]
    assert lowest == pytest.approx([0.0, 0.0], abs=5e-4)
    assert all(np.linalg.norm(entity.components[0].get_linear_velocity()) < 0.01 for entity in lying.entities)


def test_the_knife_leaves_its_path():
    world = board(box((0.06, 0.03, 0.02), [0, 0, 0.01]))
    plane = Plane(X, 0.005)
    world.apply(Cut(plane, world.truth()[0].p_WC[None]))
    edge = np.array([pose.position for pose in world.knife])
    assert abs(plane.distances(edge)).max() < 1e-12
    assert (np.diff(edge[:, 2]) < 0).all()
    assert edge[-1, 2] == pytest.approx(0.0, abs=1e-3)


def ellipsoid(rng, count):
    points = rng.normal(size=(count, 3))
    points *= [0.08, 0.02, 0.02] / np.linalg.norm(points, axis=1)[:, None]
    return as_mesh(trimesh.Trimesh(points, ConvexHull(points).simplices))


def test_the_pieces_of_a_hull_are_the_hull(rng):
    mesh = ellipsoid(rng, 500)
    pieces = [ConvexHull(corners) for corners in hull_pieces(mesh)]
    assert len(pieces) > 1
    assert max(len(piece.points) for piece in pieces) <= MAX_PIECE_CORNERS
    whole = ConvexHull(mesh.vertices)
    inside = rng.uniform(-1, 1, (4000, 3)) * [0.08, 0.02, 0.02]
    inside = inside[(inside @ whole.equations[:, :3].T + whole.equations[:, 3] < 0).all(axis=1)]
    found = [(inside @ piece.equations[:, :3].T + piece.equations[:, 3] < 1e-9).all(axis=1) for piece in pieces]
    assert np.any(found, axis=0).all()
    assert all((whole.equations[:, :3] @ p.T + whole.equations[:, 3:] < 1e-9).all() for p in hull_pieces(mesh))


def test_a_hull_of_many_corners_is_thinned_evenly_and_deterministically(rng):
    mesh = ellipsoid(rng, 3000)
    corners = np.vstack(hull_pieces(mesh))
    assert len(np.unique(corners, axis=0)) <= MAX_HULL_CORNERS + 1
    assert np.array_equal(corners, np.vstack(hull_pieces(mesh)))
    assert corners.min(axis=0) == pytest.approx(mesh.vertices.min(axis=0))
    assert ConvexHull(corners).volume > 0.98 * ConvexHull(mesh.vertices).volume


def test_a_fragment_too_thin_for_the_simulator_is_named_and_its_cut_refused():
    film = as_mesh(trimesh.creation.cylinder(radius=0.02, height=1e-5, sections=40))
    with pytest.raises(HullError, match="too thin"):
        Board(WorldSettings()).reset((Fragment(film, Pose.identity()),))
    disc = Fragment(as_mesh(trimesh.creation.cylinder(0.02, 0.01, sections=40)), Pose(np.eye(3), [0, 0, 0.005]))
    world = Board(WorldSettings(min_share=1e-6))
    world.reset((disc,))
    before = world.truth()
    result = world.apply(Cut(Plane(Z, -before[0].p_WC[2] - 0.00499), before[0].p_WC[None]))
    assert isinstance(result, Refused)
    assert "too thin" in result.reason
    assert world.truth() is before


def test_settings_reach_the_board():
    settings = Settings(world=WorldSettings(blade_thickness_mm=4.0))
    world = Board(settings.world)
    world.reset((box((0.06, 0.03, 0.02), [0, 0, 0.01]),))
    world.apply(Cut(Plane(X, 0.0), world.truth()[0].p_WC[None]))
    right, left = world.truth()
    assert right.p_WC[0] - left.p_WC[0] == pytest.approx(0.034, abs=5e-4)
