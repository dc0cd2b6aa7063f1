"""Volumes, spreads and the share that stays whole, by type."""

import json

import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.fragment import Mesh
from cutgrammar.grammar.type_statistics import MIN_STD, TypeStatistics, type_statistics


def box(*sides):
    made = trimesh.creation.box(sides)
    return Mesh(made.vertices, made.faces)


def test_statistics_follow_the_fragments_of_each_type():
    shapes = [box(0.01, 0.02, 0.04), box(0.02, 0.04, 0.02), box(0.02, 0.02, 0.02)]
    found = type_statistics(shapes, np.array([0, 0, 1]), [0], 2)
    np.testing.assert_allclose(found.log_volume, [np.log([8e-6, 16e-6]).mean(), np.log(8e-6)])
    np.testing.assert_allclose(found.log_spreads[1], np.log(0.02 / np.sqrt(12.0)))
    np.testing.assert_allclose(
        found.log_spreads[0], np.log([[0.01, 0.02, 0.04], [0.02, 0.02, 0.04]]).mean(axis=0) - np.log(12.0) / 2
    )
    assert found.log_volume_std.min() >= MIN_STD


def test_a_type_that_is_always_cut_stays_whole_less_often():
    shapes = [box(0.01, 0.02, 0.04)] * 8
    whole = type_statistics(shapes, np.array([0, 0, 0, 0, 1, 1, 1, 1]), [0, 1, 2, 3], 2).whole
    assert 0.0 < whole[0] < 0.2 < 0.8 < whole[1] < 1.0


def test_a_type_with_one_fragment_takes_the_pooled_deviation():
    shapes = [box(0.01, 0.01, s) for s in (0.01, 0.02, 0.04, 0.03)]
    found = type_statistics(shapes, np.array([0, 0, 0, 1]), [], 2)
    pooled = np.log([0.01, 0.02, 0.04]).var() * 3 / 2
    assert found.log_volume_std[1] == pytest.approx(np.sqrt(pooled))


def test_statistics_survive_json():
    found = type_statistics([box(0.01, 0.02, 0.04)], np.array([0]), [], 1)
    copy = TypeStatistics.from_json(json.loads(json.dumps(found.to_json())))
    assert all(np.array_equal(getattr(copy, name), value) for name, value in vars(found).items())


def test_an_empty_type_is_refused():
    with pytest.raises(ValueError, match="type c1 has no fragments"):
        type_statistics([box(0.01, 0.02, 0.04)], np.array([0]), [], 2)
