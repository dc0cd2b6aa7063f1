from functools import lru_cache

import numpy as np
import pytest

from cutgrammar.demonstration import objects_of
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.slicing import slice_mesh
from cutgrammar.interfaces import Stuck
from cutgrammar.methods.method import PlanningContext
from cutgrammar.methods.transfer import TRANSFER, BoxMap, carried_over
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings, TrialSettings
from cutgrammar.trials.built_in_scores import IOU_STRICT
from cutgrammar.trials.goals import goal_for
from cutgrammar.trials.run_trial import run_trial
from cutgrammar.trials.setups import SETUPS
from cutgrammar_sim import foods
from cutgrammar_sim.demonstrator.demonstrate import make_demonstration
from cutgrammar_sim.worlds.bench import Bench

SETTINGS = Settings()


@lru_cache
def demonstration(trial, setup="N1M1", categories=("slices",), food="carrot"):
    return make_demonstration(trial, SETUPS[setup], categories, {food: getattr(foods, food)}, 0, SETTINGS.demonstrator)


def reached(of, donors, goal):
    planner = TRANSFER.planner(PlanningContext(None, SETTINGS, of, donors=donors))
    events = run_trial(of.start, goal, planner, Bench(1e-3), [], stream, TrialSettings(), scores=[IOU_STRICT])
    return events[-1]


def test_a_trial_that_is_its_own_donor_is_reached():
    of = demonstration(3, "N2M2", ("cubes", "strips"), "block")
    assert reached(of, objects_of(of), of.goal).scores["iou_strict"] == pytest.approx(1.0, abs=1e-6)


def test_a_donor_that_is_the_object_scaled_and_turned_is_mapped_onto_it(lump, random_pose):
    X, X_other = random_pose(), random_pose()
    larger = Mesh(X_other.apply(1.2 * lump.vertices), lump.faces)
    box_map = BoxMap.between(lump.moved(X), larger)
    image = X.apply(lump.vertices) @ box_map.matrix.T + box_map.shift
    assert image == pytest.approx(larger.vertices, abs=1e-9)


def test_the_image_of_a_plane_divides_the_image_of_a_mesh(lump, rng):
    from cutgrammar.geometry.plane import Plane

    box_map = BoxMap(np.array([[1.0, 0.2, 0.0], [0.0, 0.8, 0.1], [0.1, 0.0, 1.4]]), np.array([0.1, 0.2, 0.3]))
    plane = Plane.through([0.004, 0.001, 0.01], rng.normal(size=3))
    image = Mesh(lump.vertices @ box_map.matrix.T + box_map.shift, lump.faces)
    above, image_above = (slice_mesh(mesh, p).above[0] for mesh, p in ((lump, plane), (image, box_map.plane(plane))))
    assert image_above.volume / image.volume == pytest.approx(above.volume / lump.volume, rel=1e-9)


@pytest.mark.parametrize("categories", [("slices",), ("strips",), ("cubes",)])
def test_the_cuts_of_another_carrot_reach_its_goal_nearly(categories):
    of, donor = demonstration(0, categories=categories), demonstration(1, categories=categories)
    donors = objects_of(donor)
    scored = reached(of, donors, goal_for(of, "foreign", stream(0), donors))
    assert scored.fragments == len(donor.goal)
    assert scored.scores["iou_strict"] > 0.75


def test_only_the_start_of_the_trial_is_used():
    of, donors = demonstration(0), objects_of(demonstration(1))
    carried = carried_over(of, donors)
    assert carried.start[0].mesh is of.start[0].mesh
    assert len(carried.cuts) == len(donors[0].cuts)
    assert carried.categories == ()


def test_transfer_is_stuck_after_the_donors_last_cut():
    of, donors = demonstration(0), objects_of(demonstration(1))
    carried = carried_over(of, donors)
    planner = TRANSFER.planner(PlanningContext(None, SETTINGS, of, donors=donors))
    assert planner.next_cut(carried.goal, of.goal, [], stream(0)) == Stuck("the demonstration has no further cut")


def test_transfer_needs_a_donor_for_every_object_and_applies_to_foreign_goals_only():
    with pytest.raises(ValueError, match="0 donors were given for 1 objects"):
        TRANSFER.planner(PlanningContext(None, SETTINGS, demonstration(0)))
    assert not TRANSFER.applies_to("in-place")
    assert not TRANSFER.applies_to("scattered")
    assert TRANSFER.applies_to("foreign")
    assert not TRANSFER.is_competitor
