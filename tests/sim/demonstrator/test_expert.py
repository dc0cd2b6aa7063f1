"""Second demonstrations: intents inferred from a demonstration and carried out with new errors."""

import dataclasses
from functools import lru_cache

import numpy as np
import pytest

from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.interfaces import Cut, Stuck
from cutgrammar.methods.method import PlanningContext
from cutgrammar.seeds import stream
from cutgrammar.settings import DemonstratorSettings, Settings, TrialSettings
from cutgrammar.trials.run_trial import run_trial
from cutgrammar.trials.setups import SETUPS
from cutgrammar_sim import foods
from cutgrammar_sim.demonstrator.demonstrate import make_demonstration
from cutgrammar_sim.demonstrator.expert import CAREFUL, EXPERT, ROUGH, ROUGH_EXPERT, ExpertPlanner
from cutgrammar_sim.demonstrator.intents import Intent, intents_of
from cutgrammar_sim.demonstrator.scripted_cuts import MAX_ERROR
from cutgrammar_sim.worlds.bench import Bench

SETTINGS = Settings()
FOODS = {name: getattr(foods, name) for name in foods.PROPORTIONS}
EXACT = DemonstratorSettings(offset_error=0.0, tilt_error_deg=0.0)


@lru_cache
def demonstration(trial=0, setup="N1M2", categories=("slices", "strips"), errors=CAREFUL):
    return make_demonstration(trial, SETUPS[setup], categories, FOODS, 0, errors)


def play(planner, of):
    bench = Bench(SETTINGS.world.min_share)
    return run_trial(of.start, of.goal, planner, bench, [], lambda *names: stream(3, *names), TrialSettings())


@pytest.mark.parametrize("errors", [EXACT, CAREFUL, ROUGH], ids=["exact", "careful", "rough"])
@pytest.mark.parametrize(
    ("setup", "categories"),
    [("N1M2", ("slices", "strips")), ("N1M1", ("chunks",)), ("N2M2", ("chunks", "cubes"))],
)
def test_the_intent_of_every_scripted_cut_can_be_inferred(setup, categories, errors):
    made = demonstration(6, setup, categories, errors)
    intents = intents_of(made)
    assert set(intents) == {cut.step for cut in made.cuts}
    assert None not in intents.values()
    assert all(0 < intent.below < intent.total for intent in intents.values())


def test_regions_are_halved_and_slices_are_cut_one_by_one():
    made = demonstration(6)
    intents = intents_of(made)
    assert intents[made.cuts[0].step] == Intent(axis=0, below=1, total=2)
    slicing = [i for i in intents.values() if i.axis == 0][1:]
    assert slicing
    assert all(i.below in (1, i.total - 1) for i in slicing)


@pytest.mark.parametrize(
    ("setup", "categories"),
    [
        ("N1M2", ("slices", "strips")),
        pytest.param("N2M3", ("chunks", "cubes", "strips"), marks=pytest.mark.slow),
    ],
)
def test_an_expert_without_errors_reaches_a_goal_without_errors(setup, categories):
    of = demonstration(1, setup, categories, EXACT)
    assert play(ExpertPlanner(of, EXACT), of)[-1].iou_strict > 1 - 1e-6


@pytest.mark.parametrize(("method", "errors"), [(EXPERT, CAREFUL), (ROUGH_EXPERT, ROUGH)])
def test_errors_are_new_and_have_the_configured_size(method, errors):
    of = demonstration(2, "N1M1", ("chunks",))
    (start,) = of.start
    intent = intents_of(of)[1]
    low, high = start.mesh.vertices.min(axis=0), start.mesh.vertices.max(axis=0)
    spacing = (high[intent.axis] - low[intent.axis]) / intent.total
    point = (low + high) / 2.0
    point[intent.axis] = low[intent.axis] + spacing * intent.below
    misses, tilts = [], []
    planner = method.planner(PlanningContext(None, SETTINGS, of))
    for seed in range(150):
        plane = planner.next_cut(of.start, of.goal, [], stream(seed)).plane_W.transformed(start.X_WF.inverse())
        along = plane.normal[intent.axis]
        misses.append(-plane.distances(point) / along / spacing)
        tilts.append(np.degrees(np.arccos(min(1.0, abs(along)))))
    assert np.abs(misses).max() <= MAX_ERROR * errors.offset_error + 1e-9
    assert np.max(tilts) <= MAX_ERROR * errors.tilt_error_deg + 1e-6
    assert np.std(misses) == pytest.approx(
        0.88 * errors.offset_error, rel=0.25
    )  # of a normal distribution truncated at 2 sigma
    assert np.sqrt(np.mean(np.square(tilts))) == pytest.approx(0.88 * errors.tilt_error_deg, rel=0.25)
    assert np.mean(misses) == pytest.approx(0.0, abs=0.3 * errors.offset_error)


def test_a_rough_second_demonstration_is_worse_than_a_careful_one():
    of = demonstration(3, "N1M1", ("slices",))
    careful, rough = (
        play(method.planner(PlanningContext(None, SETTINGS, of)), of)[-1] for method in (EXPERT, ROUGH_EXPERT)
    )
    assert rough.iou_strict < careful.iou_strict < 1.0
    assert careful.fragments == careful.goal_fragments


def test_the_intent_applies_to_a_moved_fragment_with_another_frame(random_pose):
    of = demonstration(4, "N1M1", ("slices",), EXACT)
    X, Y = random_pose(), random_pose()
    moved = tuple(Fragment(f.mesh.moved(Y), X @ f.X_WF @ Y.inverse()) for f in of.start)
    cut = ExpertPlanner(of, EXACT).next_cut(moved, of.goal, [], stream(0))
    wanted = of.cuts[0].plane_W.transformed(X)
    assert np.abs(cut.plane_W.normal @ wanted.normal) == pytest.approx(1.0, abs=1e-6)
    assert abs(wanted.distances(moved[0].p_WC) / cut.plane_W.distances(moved[0].p_WC)) == pytest.approx(1.0, abs=1e-3)


def test_the_demonstrated_plane_is_used_if_the_intent_cannot_be_inferred():
    of = demonstration(5, "N1M1", ("chunks",))
    whole = of.fragments[0].mesh
    askew = Plane.through(whole.centroid, np.array([1.0, 1.0, 0.4]))
    first = dataclasses.replace(of.cuts[0], plane_C=askew.transformed(canonical_frame(whole).inverse()))
    changed = dataclasses.replace(of, cuts=(first, *of.cuts[1:]))
    assert intents_of(changed)[1] is None
    cut = ExpertPlanner(changed, EXACT).next_cut(of.start, of.goal, [], stream(0))
    assert cut.plane_W.to_vector() == pytest.approx(askew.transformed(of.start[0].X_WF).to_vector(), abs=1e-9)
    other = ExpertPlanner(changed, CAREFUL).next_cut(of.start, of.goal, [], stream(0))
    assert 0.95 < abs(other.plane_W.normal @ cut.plane_W.normal) < 1.0


def test_an_expert_also_works_on_clouds():
    of = demonstration(2, "N1M1", ("chunks",))
    clouds = tuple(Fragment(sample_surface(f.mesh, 512), f.X_WF) for f in of.start)
    assert isinstance(EXPERT.planner(PlanningContext(None, SETTINGS, of)).next_cut(clouds, of.goal, [], stream(0)), Cut)


def test_an_expert_stops_after_the_last_cut_of_its_demonstration():
    of = demonstration(2, "N1M1", ("chunks",))
    for method in (EXPERT, ROUGH_EXPERT):
        assert method.sees_demonstration
        with pytest.raises(ValueError, match="sees_demonstration"):
            method.planner(PlanningContext(None, SETTINGS))
    assert EXPERT.planner(PlanningContext(None, SETTINGS, of)).next_cut(of.goal, of.goal, [], stream(0)) == Stuck(
        "the demonstration has no further cut"
    )
