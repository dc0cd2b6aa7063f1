import dataclasses

import numpy as np
import pytest

from cutgrammar.demonstration import objects_of
from cutgrammar.errors import InputError
from cutgrammar.geometry.comparison.overlap import Solid, best_match
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.trials.goals import FOREIGN, GOALS, goal_for

OWN = tuple(condition for condition in GOALS if condition not in FOREIGN)


def triangles(mesh, moved_by, digits=9):
    """The sorted triangles, each starting with its smallest corner and with its orientation kept."""
    found = np.round(mesh.triangles + moved_by, digits) + 0.0
    rows = []
    for corners in found.tolist():
        first = corners.index(min(corners))
        rows.append(tuple(map(tuple, corners[first:] + corners[:first])))
    return sorted(rows)


@pytest.mark.parametrize("condition", OWN)
def test_a_goal_reveals_neither_frames_nor_order(demonstrate, rng, condition):
    demonstration = demonstrate(cuts=5)
    goal = goal_for(demonstration, condition, rng)
    assert len(goal) == len(demonstration.goal) == 6
    for fragment in goal:
        assert np.array_equal(fragment.X_WF.rotation, np.eye(3))
        assert np.abs(fragment.mesh.centroid).max() < 1e-12
        assert not {id(f.shape) for f in demonstration.goal} & {id(fragment.shape)}
    volumes = [fragment.mesh.volume for fragment in goal]
    known = [fragment.mesh.volume for fragment in demonstration.goal]
    assert volumes != pytest.approx(known, rel=1e-9)
    assert sorted(volumes) == pytest.approx(sorted(known), rel=1e-9)


@pytest.mark.parametrize("condition", OWN)
def test_every_goal_has_a_new_order_of_fragments_vertices_and_faces(demonstrate, condition):
    demonstration = demonstrate(cuts=1)
    orders, firsts, faces = set(), set(), set()
    for seed in range(8):
        goal = goal_for(demonstration, condition, np.random.default_rng(seed))
        larger = max(goal, key=lambda fragment: fragment.mesh.volume)
        orders.add(goal[0].mesh.volume > goal[1].mesh.volume)
        firsts.add(round(float(np.linalg.norm(larger.mesh.vertices[0])), 9))
        faces.add(round(float(np.linalg.norm(larger.mesh.triangles[0].mean(axis=0))), 9))
    assert orders == {True, False}
    assert min(len(firsts), len(faces)) >= 6


def test_in_place_goals_have_the_same_triangles_at_the_same_places(demonstrate, rng):
    demonstration = demonstrate(cuts=3)
    goal = goal_for(demonstration, "in-place", rng)
    seen = sorted(triangles(f.mesh, f.X_WF.position) for f in goal)
    true = sorted(triangles(f.mesh.moved(f.X_WF), 0.0) for f in demonstration.goal)
    assert seen == true


def test_scattered_goals_are_rotated_and_spread_out_at_the_same_height(demonstrate, rng):
    demonstration = demonstrate(cuts=6)
    goal = goal_for(demonstration, "scattered", rng)
    placed = [f.X_WF.apply(f.mesh.vertices) for f in goal]
    diameter = max(np.linalg.norm(v[:, None] - v[None], axis=2).max() for v in placed)
    for i, a in enumerate(placed):
        for b in placed[:i]:
            assert np.linalg.norm(a[:, None] - b[None], axis=2).min() >= diameter
    lowest = min(f.X_WF.apply(f.mesh.vertices)[:, 2].min() for f in demonstration.goal)
    assert [v[:, 2].min() for v in placed] == pytest.approx([lowest] * len(goal), abs=1e-12)
    in_place = goal_for(demonstration, "in-place", np.random.default_rng(1))
    for fragment in goal:
        twin = min(in_place, key=lambda other: abs(other.mesh.volume - fragment.mesh.volume))
        gap = np.abs(np.sort(fragment.mesh.vertices, axis=0) - np.sort(twin.mesh.vertices, axis=0)).max()
        assert gap > 1e-3, "this one was not turned"


@pytest.mark.parametrize("condition", OWN)
def test_a_goal_has_iou_1_with_the_configuration_it_was_made_from(demonstrate, rng, condition):
    demonstration = demonstrate(cuts=4)
    goal = goal_for(demonstration, condition, rng)
    matching = best_match([Solid(f.mesh) for f in goal], [Solid(f.mesh) for f in demonstration.goal])
    assert matching.strict == pytest.approx(1.0, abs=1e-9)


def test_the_same_stream_gives_the_same_goal(demonstrate):
    demonstration = demonstrate(cuts=3)
    for condition in OWN:
        a, b = (goal_for(demonstration, condition, np.random.default_rng(4)) for _ in range(2))
        for x, y in zip(a, b, strict=True):
            assert np.array_equal(x.mesh.vertices, y.mesh.vertices)
            assert np.array_equal(x.mesh.faces, y.mesh.faces)
            assert np.array_equal(x.X_WF.to_vector(), y.X_WF.to_vector())


def test_an_unknown_condition_is_refused(demonstrate, rng):
    with pytest.raises(InputError, match="known: in-place, scattered, foreign, foreign-food"):
        goal_for(demonstrate(), "afar", rng)


def foreign(present, donors, seed=2):
    return goal_for(present, "foreign", np.random.default_rng(seed), donors)


def solids(configuration):
    return [Solid(fragment.mesh) for fragment in configuration]


@pytest.fixture
def trio(demonstrate):
    """A trial with two objects, and a donor for each from two other trials."""
    present = demonstrate(0, "N2M1", foods=("potato", "potato"), cuts=4)
    others = [demonstrate(trial, cuts=cuts) for trial, cuts in ((1, 3), (2, 5))]
    return present, tuple(objects_of(other)[0] for other in others)


def test_a_foreign_goal_is_what_the_donors_were_cut_into(trio):
    present, donors = trio
    goal = foreign(present, donors)
    theirs = [fragment for donor in donors for fragment in donor.goal]
    assert len(goal) == len(theirs) == 4 + 6 != len(present.goal)
    assert best_match(solids(goal), solids(theirs)).strict == pytest.approx(1.0, abs=1e-9)
    assert best_match(solids(goal), solids(present.goal)).mean < 0.9


def test_nothing_of_the_present_cuts_is_in_a_foreign_goal(trio, demonstrate):
    present, donors = trio
    other_cuts = dataclasses.replace(
        present,
        fragments=present.fragments[:2],
        poses={key: X for key, X in present.poses.items() if key[0] == 0},
        cuts=(),
    )
    for a, b in zip(foreign(present, donors), foreign(other_cuts, donors), strict=True):
        assert np.array_equal(a.mesh.vertices, b.mesh.vertices)
        assert np.array_equal(a.mesh.faces, b.mesh.faces)
        assert np.array_equal(a.X_WF.to_vector(), b.X_WF.to_vector())


def test_a_donor_is_scaled_to_the_volume_of_its_object_and_lies_about_it(demonstrate):
    present, donor = demonstrate(0), objects_of(demonstrate(3, cuts=4))[0]
    (whole,) = present.start
    larger = dataclasses.replace(
        present,
        fragments=(
            dataclasses.replace(present.fragments[0], mesh=Mesh(1.3 * whole.mesh.vertices, whole.mesh.faces)),
            *present.fragments[1:],
        ),
    )
    goal = foreign(larger, (donor,))
    assert sum(fragment.mesh.volume for fragment in goal) == pytest.approx(1.3**3 * whole.mesh.volume)
    middle = np.mean([fragment.p_WC for fragment in goal], axis=0)
    spacing = np.ptp([fragment.p_WC[:2] for fragment in goal])
    assert middle[:2] == pytest.approx(larger.start[0].p_WC[:2], abs=spacing)
    corners = np.vstack([fragment.X_WF.apply(fragment.mesh.vertices) for fragment in goal])
    (large,) = larger.start
    assert corners[:, 2].min() == pytest.approx(large.X_WF.apply(large.mesh.vertices)[:, 2].min())


def test_foreign_goals_lie_apart_and_turned(trio):
    present, donors = trio
    placed = [f.X_WF.apply(f.mesh.vertices) for f in foreign(present, donors)]
    gaps = [np.linalg.norm(a[:, None] - b[None], axis=2).min() for i, a in enumerate(placed) for b in placed[:i]]
    assert min(gaps) > 0.05


def test_a_foreign_goal_needs_a_donor_for_every_object(trio):
    present, donors = trio
    with pytest.raises(ValueError, match="1 donors were given for 2 objects"):
        foreign(present, donors[:1])
