import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.planning.scene import PlanningScene
from cutgrammar_sim.arm.planning.turning import GAP, LEANS, SHORT, find_grasps, find_spots, find_turns, surface_above
from cutgrammar_sim.arm.robot.collision import CollisionChecker
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.tool import knife
from simple_shapes import box_fragment as box

X, Y, Z = np.eye(3)
TOOL = knife(Settings())
MAX_TILT = np.radians(35.0)


def turned(fragment, turn):
    """Corners about the centroid after the turn."""
    return (fragment.X_WF.apply(fragment.mesh.vertices) - fragment.p_WC) @ turn.rotation.T


def test_every_turn_makes_the_plane_upright_or_falls_short_by_at_most_the_tolerance(rng):
    for _ in range(20):
        fragment = box((0.06, 0.04, 0.03), [0.02, 0.01, 0.015], rng.uniform(0.0, np.pi))
        n = rng.normal(size=3)
        plane = Plane.through(fragment.p_WC, n)
        turns = find_turns(fragment, plane, TOOL, MAX_TILT)
        assert turns
        for turn in turns:
            assert turn.axis_W[2] == 0.0
            leans = np.arcsin(abs((turn.rotation @ plane.normal)[2]))
            assert abs(turn.angle) <= np.pi / 2.0 + 1e-9 or abs(turn.angle) < np.radians(101.0)
            assert leans < 1e-9 or leans <= SHORT + 1e-9 or turn.angle == 0.0
            assert leans <= MAX_TILT + 1e-9


def test_the_smallest_turn_comes_first_and_an_upright_plane_needs_none():
    fragment = box((0.06, 0.04, 0.03), [0, 0, 0.015])
    assert find_turns(fragment, Plane.through(fragment.p_WC, X), TOOL, MAX_TILT)[0].angle == 0.0
    lean = np.radians(50.0)
    first = find_turns(fragment, Plane.through(fragment.p_WC, [np.cos(lean), 0.0, np.sin(lean)]), TOOL, MAX_TILT)[0]
    assert abs(first.angle) == pytest.approx(lean)
    assert abs(first.axis_W) == pytest.approx(Y)


def test_a_bar_cut_along_its_length_is_turned_onto_a_face_and_not_set_on_end():
    bar = box((0.16, 0.03, 0.02), [0, 0, 0.01], 0.4)
    first = find_turns(bar, Plane.through(bar.p_WC, Z), TOOL, MAX_TILT)[0]
    corners = turned(bar, first)
    assert np.ptp(corners[:, 2]) == pytest.approx(0.03, abs=1e-9)
    assert abs(first.angle) == pytest.approx(np.pi / 2.0)


def test_no_turn_makes_the_section_higher_than_the_blade():
    bar = box((0.16, 0.03, 0.02), [0, 0, 0.01])
    for turn in find_turns(bar, Plane.through(bar.p_WC, Z), TOOL, MAX_TILT):
        corners = turned(bar, turn)
        plane = turn.rotation @ Z
        in_plane = corners[np.abs(corners @ plane) < 0.02]
        assert in_plane[:, 2].max() - corners[:, 2].min() <= TOOL.height + 1e-9


def test_the_tool_leans_within_its_range_before_and_after_the_turn_and_its_edge_is_level():
    fragment = box((0.06, 0.04, 0.03), [0.02, 0.01, 0.015])
    for turn in find_turns(fragment, Plane.through(fragment.p_WC, Z), TOOL, MAX_TILT)[:4]:
        grasps = list(find_grasps(fragment, turn))
        assert grasps
        for X_WG in grasps:
            for rotation in (X_WG.rotation, turn.rotation @ X_WG.rotation):
                assert rotation[2, 1] == pytest.approx(0.0, abs=1e-9)
                lean = np.degrees(np.arctan2(-rotation[2, 0], rotation[2, 2]))
                assert LEANS[0] - 1e-6 <= lean <= LEANS[1] + 1e-6
            tips = fragment.X_WF.inverse().apply(X_WG.position)
            assert (np.abs(tips) < [0.03, 0.02, 0.015]).all()  # the needles are in the fragment
            assert X_WG.position[2] > fragment.p_WC[2]


def test_the_surface_is_found_above_a_point_inside_the_outline_only(lump):
    fragment = Fragment(lump, Pose(np.eye(3), [0.0, 0.0, 0.06]))
    low, high = surface_above(fragment, np.zeros(2))
    solid = trimesh.Trimesh(lump.vertices, lump.faces)
    for height, inside in ((high - 1e-4, True), (high + 1e-4, False), (low + 1e-4, True), (low - 1e-4, False)):
        assert solid.contains([[0.0, 0.0, height - 0.06]])[0] == inside
    assert surface_above(fragment, np.array([0.2, 0.0])) is None


def test_a_fragment_is_set_down_on_the_board_clear_of_others_with_room_for_the_blade(rng):
    fragment = box((0.06, 0.04, 0.03), [0.02, 0.01, 0.015])
    others = tuple(box((0.03, 0.03, 0.03), [*rng.uniform(-0.15, 0.15, 2), 0.015], k) for k in range(6))
    taken = PlanningScene(CollisionChecker(gen3(), TOOL), others).footprint
    plane = Plane.through(fragment.p_WC, Z)
    turn = find_turns(fragment, plane, TOOL, MAX_TILT)[0]
    spots = list(find_spots(fragment, turn, plane, TOOL, taken))
    assert len(spots) > 20
    for X_WF in spots[::7]:
        corners = X_WF.apply(fragment.mesh.vertices)
        assert corners[:, 2].min() == pytest.approx(0.0, abs=1e-9)
        R_move = X_WF.rotation @ fragment.X_WF.rotation.T
        assert abs((R_move @ plane.normal)[2]) < 1e-9
        for other in others:
            near = other.X_WF.apply(other.mesh.vertices)
            gap = np.linalg.norm(corners[:, None, :2] - near[None, :, :2], axis=2).min()
            assert gap > GAP / 2.0
    distances = [np.linalg.norm((X_WF.apply(fragment.mesh.centroid))[:2]) for X_WF in spots]
    assert (np.diff(distances) > -1e-9).all()  # those nearest to the middle first


def test_a_full_board_has_no_free_place():
    fragment = box((0.06, 0.04, 0.03), [0.02, 0.01, 0.015])
    plane = Plane.through(fragment.p_WC, Z)
    turn = find_turns(fragment, plane, TOOL, MAX_TILT)[0]
    everywhere = np.stack(np.meshgrid(np.arange(-0.4, 0.4, 0.02), np.arange(-0.5, 0.5, 0.02)), axis=-1).reshape(-1, 2)
    assert list(find_spots(fragment, turn, plane, TOOL, everywhere)) == []
