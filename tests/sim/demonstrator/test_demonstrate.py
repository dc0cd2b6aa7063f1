import dataclasses
import pickle
from collections import Counter
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest

from cutgrammar.demonstration import CATEGORIES, Demonstration
from cutgrammar.geometry.canonical import canonical_frame, extents
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.slicing import solid_of
from cutgrammar.settings import DemonstratorSettings
from cutgrammar.trials.setups import SETUPS, Setup
from cutgrammar_sim import foods
from cutgrammar_sim.demonstrator.demonstrate import GAP, definition_digest, make_demonstration
from cutgrammar_sim.demonstrator.habits import HABITS

FOODS = {name: getattr(foods, name) for name in foods.PROPORTIONS}
FROZEN = "1ffaca8b05bae61f2128e197587a65803ba0ca9d3349749e8d82e39242318d5e"
USUAL = DemonstratorSettings()
EXACT = DemonstratorSettings(offset_error=0.0, tilt_error_deg=0.0)
ROUGH = DemonstratorSettings(offset_error=0.3, tilt_error_deg=6.0)


@lru_cache
def demonstration(trial: int, setup: str, categories: tuple[str, ...], settings=USUAL) -> Demonstration:
    return make_demonstration(trial, SETUPS[setup], categories, FOODS, 0, settings)


def some() -> list[Demonstration]:
    """One or two of every setup, and of every category alone."""
    jobs = [(name, (category,)) for category in CATEGORIES for name in ("N1M1", "N2M1")]
    jobs += [("N1M2", CATEGORIES[:2]), ("N1M2", CATEGORIES[2:]), ("N2M2", CATEGORIES[1:3])]
    jobs += [("N2M3", CATEGORIES[1:]), ("N2M3", CATEGORIES[:3]), ("N3M4", CATEGORIES), ("N3M4", CATEGORIES[::-1])]
    return [demonstration(trial, *job) for trial, job in enumerate(jobs)]


def same(a: Demonstration, b: Demonstration) -> bool:
    return (
        a.foods == b.foods
        and len(a.fragments) == len(b.fragments)
        and all((f.mesh.vertices == g.mesh.vertices).all() for f, g in zip(a.fragments, b.fragments, strict=True))
        and all((p.plane_W.to_vector() == q.plane_W.to_vector()).all() for p, q in zip(a.cuts, b.cuts, strict=True))
        and a.poses.keys() == b.poses.keys()
        and all((a.poses[key].to_vector() == b.poses[key].to_vector()).all() for key in a.poses)
    )


def volume(meshes) -> float:
    return sum(mesh.volume for mesh in meshes)


def test_a_demonstration_does_not_depend_on_earlier_ones():
    def fresh(trial):
        return make_demonstration(trial, SETUPS["N2M3"], CATEGORIES[:3], FOODS, 5, DemonstratorSettings())

    first = fresh(7)
    fresh(8)
    assert same(first, fresh(7))
    assert not same(first, fresh(8))


def test_a_demonstration_can_be_sent_to_another_process():
    made = demonstration(0, "N1M1", ("slices",))
    assert same(made, pickle.loads(pickle.dumps(made)))


def test_the_order_of_foods_and_categories_does_not_matter():
    a = make_demonstration(1, SETUPS["N2M3"], CATEGORIES[:3], FOODS, 0, EXACT)
    b = make_demonstration(1, SETUPS["N2M3"], CATEGORIES[2::-1], dict(reversed(FOODS.items())), 0, EXACT)
    assert a.categories == b.categories
    assert same(a, b)


def test_a_demonstration_has_the_objects_and_categories_of_its_setup():
    for made in some():
        setup = SETUPS[made.setup]
        assert len(made.start) == len(made.foods) == setup.objects
        goal = [made.fragments[i].category for i in made.alive(made.steps)]
        assert {*goal} == {*made.categories}
        assert len(made.categories) == setup.categories
        assert len(made.goal) <= 12 * setup.objects + 6 * (len(made.categories) > setup.objects)
        assert len(made.goal) < 36


def test_a_goal_of_three_objects_and_four_categories_stays_under_36_fragments():
    assert max(len(demonstration(trial, "N3M4", CATEGORIES).goal) for trial in range(8)) < 36


def test_every_object_has_one_category_if_there_are_more_objects_than_categories():
    made = make_demonstration(0, Setup(5, 2, 1), ("chunks", "slices"), FOODS, 0, EXACT)
    roots = {}
    for fragment in made.fragments:
        roots[fragment.id] = fragment.id if fragment.parent is None else roots[fragment.parent]
    found = {(roots[i], made.fragments[i].category) for i in made.alive(made.steps)}
    assert len(found) == 5
    assert {category for _, category in found} == {"chunks", "slices"}


def test_cuts_conserve_volume_and_products_lie_on_their_sides():
    for made in some():
        for cut in made.cuts:
            mesh = made.fragments[cut.fragment].mesh
            products = [made.fragments[i].mesh for i in cut.products]
            assert volume(products) == pytest.approx(mesh.volume, rel=1e-9)
            X_WF = made.poses[cut.step - 1, cut.fragment]
            sides = []
            assert min(product.volume for product in products) >= 1e-3 * mesh.volume
            for product in products:
                assert solid_of(product).genus() == 0
                distances = cut.plane_W.distances(X_WF.apply(product.vertices))
                assert distances.min() > -1e-6 or distances.max() < 1e-6
                sides.append(distances.mean() > 0)
            assert set(sides) == {True, False}


def test_the_plane_in_the_canonical_frame_is_the_plane_in_the_world():
    for made in some():
        for cut in made.cuts:
            X_FC = canonical_frame(made.fragments[cut.fragment].mesh)
            X_WC = made.poses[cut.step - 1, cut.fragment] @ X_FC
            assert cut.plane_C.transformed(X_WC).to_vector() == pytest.approx(cut.plane_W.to_vector(), abs=1e-9)


def test_steps_parents_poses_and_categories_are_consistent():
    for made in some():
        assert [cut.step for cut in made.cuts] == list(range(1, made.steps + 1))
        alive = set(range(len(made.start)))
        assert set(made.alive(0)) == alive
        for cut in made.cuts:
            assert cut.fragment in alive
            alive = alive - {cut.fragment} | set(cut.products)
            assert set(made.alive(cut.step)) == alive
            for product in cut.products:
                fragment = made.fragments[product]
                assert (fragment.id, fragment.parent, fragment.step) == (product, cut.fragment, cut.step)
                assert made.poses[cut.step, product] is made.poses[cut.step - 1, cut.fragment]
        for fragment in made.fragments:
            assert (fragment.category is not None) == (fragment.id in alive)


def test_objects_lie_on_the_board_along_x_side_by_side_with_clear_gaps():
    for made in some():
        boxes = []
        for fragment in made.start:
            points = fragment.X_WF.apply(fragment.mesh.vertices)
            assert points[:, 2].min() == pytest.approx(0.0, abs=1e-12)
            assert fragment.X_WF.rotation[0, 0] > np.cos(np.radians(16))
            boxes.append((points[:, 1].min(), points[:, 1].max()))
            assert np.abs(points[:, 0]).max() < 0.15
        for (_, end), (start, _) in pairwise(boxes):
            assert start - end >= GAP[0] - 1e-12
        assert boxes[0][0] + boxes[-1][1] == pytest.approx(0.0, abs=1e-12)


def shape_of(mesh: Mesh) -> np.ndarray:
    """Extents along the axes of the object's frame F: length, larger and smaller side."""
    length, *sides = np.ptp(mesh.vertices, axis=0)
    return np.array([length, max(sides), min(sides)])


@pytest.mark.parametrize("category", CATEGORIES)
def test_fragments_look_like_their_category(category):
    for trial in range(6):
        made = demonstration(trial, "N1M1", (category,), EXACT)
        shapes = np.array([shape_of(made.fragments[i].mesh) for i in made.alive(made.steps)])
        length, wide, narrow = np.median(shapes, axis=0)
        if category == "slices":
            assert length < 0.7 * narrow
            assert 4 <= len(shapes) <= 9
        elif category == "chunks":
            assert 0.5 * wide < length < 1.5 * narrow
            assert 2 <= len(shapes) <= 5
        elif category == "strips":
            assert length > 2.0 * wide
            assert len(shapes) in (4, 6)
        else:
            assert max(length, wide) < 2.0 * min(length, narrow)
            assert 8 <= len(shapes) <= 12


def test_slices_are_cut_from_one_end_and_other_categories_by_halving():
    slices = demonstration(0, "N1M1", ("slices",), EXACT)
    for cut in slices.cuts[:-1]:
        assert [slices.fragments[i].category for i in cut.products].count("slices") == 1
    cubes = demonstration(0, "N1M1", ("cubes",), EXACT)
    depth = {0: 0}
    for cut in cubes.cuts:
        depth |= dict.fromkeys(cut.products, depth[cut.fragment] + 1)
    assert max(depth.values()) <= 4  # ceil(log2(3)) + 1 + 1


def test_planes_are_perpendicular_to_the_axes_only_without_errors():
    for cut in demonstration(3, "N2M2", ("chunks", "strips"), EXACT).cuts:
        X_WF = demonstration(3, "N2M2", ("chunks", "strips"), EXACT).poses[cut.step - 1, cut.fragment]
        assert np.abs(cut.plane_W.transformed(X_WF.inverse()).normal).max() == pytest.approx(1.0, abs=1e-12)
    tilts = []
    for trial in range(8):
        made = demonstration(trial, "N1M1", ("slices",))
        for cut in made.cuts:
            n_F = cut.plane_W.transformed(made.poses[cut.step - 1, cut.fragment].inverse()).normal
            tilts.append(np.degrees(np.arccos(min(abs(n_F[0]), 1.0))))
    assert 1.0 < np.sqrt(np.mean(np.square(tilts))) < 2.5
    assert max(tilts) <= 4.0 + 1e-9


def test_cuts_do_not_meet_each_other_even_with_large_errors():
    for trial, category in enumerate(CATEGORIES):
        made = demonstration(trial, "N1M1", (category,), ROUGH)
        counts = Counter(len(cut.products) for cut in made.cuts)
        assert set(counts) <= {2, 3}
        assert volume(f.mesh for f in made.goal) == pytest.approx(volume(f.mesh for f in made.start), rel=1e-9)
        for cut in made.cuts:
            if category == "slices":  # a slice that another cut meets would have an edge of zero thickness
                for i in cut.products:
                    lowest, highest = extents(made.fragments[i].mesh, canonical_frame(made.fragments[i].mesh))
                    assert (highest - lowest).min() > 1e-3


def test_a_food_that_suits_no_category_is_cut_anyway():
    made = make_demonstration(0, SETUPS["N1M1"], ("cubes",), {"carrot": foods.carrot}, 0, EXACT)
    assert len(made.goal) == 12


def test_unknown_repeated_or_missing_categories_and_no_foods_are_refused():
    for categories in [("dice",), ("slices", "cubes"), ()]:
        with pytest.raises(ValueError, match="N1M1 needs 1 of the categories"):
            make_demonstration(0, SETUPS["N1M1"], categories, FOODS, 0, EXACT)
    with pytest.raises(ValueError, match="no foods"):
        make_demonstration(0, SETUPS["N1M1"], ("cubes",), {}, 0, EXACT)


def test_the_definition_of_the_demonstrations_is_frozen():
    assert definition_digest(USUAL) == FROZEN
    assert definition_digest(ROUGH) != FROZEN
    assert definition_digest(USUAL, FOODS) == FROZEN


def test_foods_on_request_are_part_of_the_definition_of_data_sets_that_use_them():
    assert definition_digest(USUAL, [*FOODS, "banana"]) != FROZEN
    assert definition_digest(USUAL, ["banana"]) != definition_digest(USUAL, ["apple"])


def test_the_habit_of_every_category_is_part_of_the_definition():
    assert {*HABITS} == {*CATEGORIES}
    assert dataclasses.replace(HABITS["cubes"], spacing=0.7) != HABITS["cubes"]


def test_a_food_that_is_inside_out_is_refused_with_its_name():
    def leek(rng):
        carrot = foods.carrot(rng)
        return Mesh(carrot.vertices, carrot.faces[:, ::-1])

    with pytest.raises(ValueError, match=r"food 'leek' draws a mesh of -\d+"):
        make_demonstration(0, SETUPS["N1M1"], ("chunks",), {"leek": leek}, 0, DemonstratorSettings())


@pytest.mark.parametrize(("number", "trial"), [(8, 0), (16, 1), (32, 2), (48, 3), (64, 4)])
def test_diced_objects_have_the_number_of_fragments_asked_for_and_nearly_cubic_ones(number, trial):
    made = make_demonstration(trial, SETUPS["N1M1"], ("cubes",), FOODS, 5, USUAL, number)
    goal = [fragment.mesh for fragment in made.goal]
    assert number <= len(goal) <= number + 2  # a crumb counts as a fragment
    assert volume(goal) == pytest.approx(made.fragments[0].mesh.volume)
    sizes = np.array([extents(mesh, canonical_frame(mesh)) for mesh in goal])
    assert np.median(sizes.max(axis=1) / sizes.min(axis=1)) < 3.0


def test_dice_of_several_categories_are_refused():
    with pytest.raises(ValueError, match="dice are of one category, not of 2"):
        make_demonstration(0, SETUPS["N1M2"], CATEGORIES[:2], FOODS, 5, USUAL, 8)
