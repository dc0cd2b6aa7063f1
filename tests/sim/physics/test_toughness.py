import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import slice_mesh
from cutgrammar.plugins import FOODS, names_in
from cutgrammar.settings import KinovaSettings
from cutgrammar_sim.physics.section import section
from cutgrammar_sim.physics.toughness import (
    FRACTURE,
    FRICTION,
    SIDE_PRESSURE,
    TOUGHEST,
    fracture_toughness,
    max_resistance,
    resistance,
)

X, Y, Z = np.eye(3)
RUB = 2 * FRICTION * SIDE_PRESSURE


def sections(*shapes):
    return [section(Fragment(Mesh(s.vertices, s.faces), Pose.identity()), Plane(X, 0.0)) for s in shapes]


def box(size, at):
    return trimesh.creation.box(size).apply_translation(at)


def test_every_food_has_a_toughness_and_an_unknown_one_counts_as_the_toughest():
    assert set(names_in(FOODS)) <= set(FRACTURE)
    assert fracture_toughness("my_scan", 300.0) == fracture_toughness(None, 300.0) == 300.0
    assert fracture_toughness("carrot", 300.0) == FRACTURE["carrot"]
    assert KinovaSettings().toughness == TOUGHEST
    assert fracture_toughness("my_scan") == fracture_toughness(None) == TOUGHEST == max(FRACTURE.values())


def test_a_bar_resists_with_its_toughness_times_its_width_and_friction_that_grows_with_depth():
    met = resistance(sections(box((0.02, 0.05, 0.03), [0, 0.01, 0.015])), [400.0], Y, -Z, height=0.08)
    assert met.depths[[0, -1]] == pytest.approx([-0.03, 0.0])
    force, middle = met.at(-0.03 + 1e-6)
    assert force == pytest.approx(400 * 0.05, rel=1e-3)
    assert middle == pytest.approx(0.01)
    assert met.at(-1e-9)[0] == pytest.approx(400 * 0.05 + RUB * 0.05 * 0.03, rel=1e-3)
    assert met.at(-0.031) == met.at(0.001) == (0.0, 0.0)
    assert met.forces.max() == pytest.approx(met.at(-1e-12)[0])


def test_the_work_of_fracture_is_the_toughness_times_the_area_of_the_section(lump):
    fragment = Fragment(lump, Pose.identity())
    plane = Plane.through(lump.centroid, X)
    half = slice_mesh(lump, plane).above[0]
    cut_face = (abs(plane.distances(half.vertices)) < 1e-9)[half.faces].all(axis=1)
    a, b, c = np.moveaxis(half.triangles[cut_face], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    met = resistance([section(fragment, plane)], [250.0], Y, -Z, height=1.0)
    rubbed = resistance([section(fragment, plane)], [0.0], Y, -Z, height=1.0)
    work = np.trapezoid(met.forces - rubbed.forces, met.depths)
    assert work == pytest.approx(250.0 * area, rel=2e-3)
    assert rubbed.forces[-1] == pytest.approx(RUB * area, rel=2e-3)
    assert (np.diff(rubbed.forces) >= 0).all()


def test_gaps_between_fragments_have_no_resistance_and_each_fragment_its_own_toughness():
    pair = sections(box((0.02, 0.02, 0.03), [0, -0.05, 0.015]), box((0.02, 0.04, 0.02), [0, 0.05, 0.01]))
    met = resistance(pair, [100.0, 300.0], Y, -Z, height=0.08)
    force, middle = met.at(-0.025)
    assert force == pytest.approx(100 * 0.02 + RUB * 0.02 * 0.005, rel=1e-2)
    assert middle == pytest.approx(-0.05)
    force, middle = met.at(-0.01)
    assert force == pytest.approx(100 * 0.02 + 300 * 0.04 + RUB * (0.02 * 0.02 + 0.04 * 0.01), rel=1e-2)
    assert middle == pytest.approx((0.02 * -0.05 + 0.04 * 0.05) / 0.06, rel=1e-2)


def test_a_hollow_section_resists_where_there_is_food_only():
    ring = box((0.02, 0.06, 0.04), [0, 0, 0.02]).difference(box((0.03, 0.04, 0.02), [0, 0, 0.02]))
    met = resistance(sections(ring), [1000.0], Y, -Z, height=0.001)
    assert met.at(-0.02)[0] == pytest.approx(1000 * 0.02, rel=1e-2)
    assert met.at(-0.035)[0] == pytest.approx(1000 * 0.06, rel=1e-2)


def test_only_food_beside_the_blade_causes_friction():
    met = resistance(sections(box((0.02, 0.05, 0.03), [0, 0, 0.015])), [0.0], Y, -Z, height=0.01)
    assert met.at(-0.005)[0] == pytest.approx(RUB * 0.05 * 0.01, rel=1e-2)


def test_no_direction_of_the_blade_meets_more_than_the_upper_bound(lump):
    cut = section(Fragment(lump, Pose.identity()), Plane.through(lump.centroid, X))
    upper_bound = max_resistance([cut], [300.0])
    met = []
    for angle in np.linspace(0.0, np.pi, 19):
        across, along = np.cos(angle) * Y + np.sin(angle) * Z, np.cos(angle) * Z - np.sin(angle) * Y
        met.append(resistance([cut], [300.0], across, along, height=1.0).forces.max())
    assert max(met) <= upper_bound <= 1.3 * max(met)
