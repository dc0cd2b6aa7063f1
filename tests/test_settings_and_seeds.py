import dataclasses
import json
import subprocess
import sys

import numpy as np
import pytest

from cutgrammar.errors import InputError
from cutgrammar.plugins import METHODS, WORLDS, load, names_in, reference_of
from cutgrammar.seeds import stream
from cutgrammar.settings import SearchSettings, Settings, from_tables, load_settings


def test_a_file_changes_only_the_settings_that_it_contains(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("[search]\nmax_rounds = 7\nlayout_length_scale = 1\n[induction]\ngammas = [-1, -2.5]\n")
    settings = load_settings(file)
    assert (settings.search.max_rounds, settings.search.layout_length_scale) == (7, 1.0)
    assert settings.induction.gammas == (-1.0, -2.5)
    assert settings.world == Settings().world


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[serch]\nmax_rounds = 7", "unknown setting serch; known: demonstrator, features, "),
        ("[search]\nmax_round = 7", "divide_by_type_prior; did you mean max_rounds?"),
        ("[search]\nmax_rounds = 'many'", "search.max_rounds = 'many' is not a whole number"),
        ("[search]\nmax_rounds = true", "search.max_rounds = True is not a whole number"),
        ("[search]\nmax_rounds = 7.0", "search.max_rounds = 7.0 is not a whole number"),
        ("[search]\nmax_rounds = 0", "search.max_rounds = 0 is too small; the minimum is 1"),
        ("[search]\nexploration = '1'", "search.exploration = '1' is not a number"),
        ("[search]\ndivide_by_type_prior = 1", "search.divide_by_type_prior = 1 is not true or false"),
        ("[search]\nswaps_per_terminal = -1", "search.swaps_per_terminal = -1 is too small; the minimum is 0"),
        (
            "[search]\nlayout_length_scale = 0",
            "search.layout_length_scale = 0 is too small; it must be greater than 0",
        ),
        ("[kinova]\npress_speed = 0", "kinova.press_speed = 0 is too small; it must be greater than 0"),
        ("[world]\nmin_share = -0.5", "world.min_share = -0.5 is too small; the minimum is 0"),
        ("[induction]\ngammas = [-1.0, nan]", "induction.gammas.1 = nan is not a finite number"),
        ("[induction]\ngammas = -1.0", "induction.gammas = -1.0 is not a list in square brackets"),
        ("[world]\nmin_share = 2.0", "world.min_share = 2.0 is too large; the maximum is 0.5"),
        ("[demonstrator]\noffset_error = 50", "demonstrator.offset_error = 50 is too large; the maximum is 1"),
        ("[features]\nn_points = 3", "features.n_points = 3 is too small; the minimum is 32"),
        ("[kinova]\nflange = 3", "kinova.flange = 3 is not text in quotes"),
        (
            "[induction]\nmodel_size = 'big'",
            "induction.model_size = 'big' is unknown; known: types, types+productions",
        ),
        ("[induction]\ngammas = []", "induction.gammas is empty; at least one value is needed"),
        ("search = 3", "search must be a table, not 3"),
        ("[search\n", "cannot be read"),
    ],
)
def test_the_error_about_a_wrong_file_names_the_file_and_the_mistake(tmp_path, text, message):
    file = tmp_path / "mine.toml"
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        load_settings(file)
    assert message in str(caught.value)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        load_settings(tmp_path / "none.toml")


def test_settings_survive_the_round_trip_through_json():
    again = from_tables(json.loads(json.dumps(dataclasses.asdict(Settings()))), "JSON")
    assert again == Settings()


def test_bounds_are_checked_in_python_too():
    with pytest.raises(ValueError, match="max_rounds"):
        SearchSettings(max_rounds=0)
    with pytest.raises(ValueError, match="max_rounds"):
        dataclasses.replace(SearchSettings(), max_rounds=0)


def test_streams_differ_by_every_part_of_their_name():
    numbers = {stream(0, "a", 1).integers(2**62), stream(0, "a", 2).integers(2**62), stream(0, "b", 1).integers(2**62)}
    assert len(numbers | {stream(1, "a", 1).integers(2**62), stream(0, "a", "1").integers(2**62)}) == 5


def test_a_numpy_integer_names_the_same_stream_as_a_python_integer():
    assert stream(0, "a", np.int64(7)).integers(2**62) == stream(0, "a", 7).integers(2**62)


def test_streams_do_not_depend_on_the_hash_seed():
    code = "from cutgrammar.seeds import stream; print(stream(3, 'x', 4).integers(2**62))"
    outputs = {
        subprocess.run(
            [sys.executable, "-c", code], env={"PYTHONHASHSEED": seed}, capture_output=True, check=True
        ).stdout
        for seed in ("0", "1")
    }
    assert outputs == {f"{stream(3, 'x', 4).integers(2**62)}\n".encode()}


def test_the_error_about_an_unknown_name_lists_the_first_known_names():
    with pytest.raises(
        InputError, match="method 'gramar' is unknown; known: bc, copy, .* and [0-9]+ more; did you mean grammar"
    ):
        reference_of(METHODS, "gramar")
    assert names_in(WORLDS) == ["bench", "board", "kinova"]


def test_the_error_about_a_missing_module_suggests_installation():
    with pytest.raises(InputError, match="install"):
        load("no_such_package:thing")


def test_an_unknown_name_in_a_list_of_tables_is_named():
    tables = json.loads(json.dumps(dataclasses.asdict(Settings())))
    tables["fitting"]["levels"][0]["banana"] = 7
    with pytest.raises(InputError, match=r"unknown setting fitting\.levels\.banana"):
        from_tables(tables, "model.json")
