"""JSON and TOML of strangers: limits on nesting and numbers, and values to the last bit."""

import json
import struct

import numpy as np
import pytest

from cutgrammar.untrusted import parse_json, parse_toml


def test_numbers_are_read_to_the_last_bit(rng):
    numbers = [x for x in struct.unpack("2000d", rng.bytes(16000)) if np.isfinite(x)]
    whole = [0, -1, 2**63 - 1, -(2**63)]
    assert parse_json(json.dumps([numbers, whole])) == [numbers, whole]
    assert parse_json(b'{"a": 1, "b": [1.0, "x\\u00e9"]}') == {"a": 1, "b": [1.0, "xé"]}


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000 + "]" * 100_000,
        '{"a":' * 5000 + "1" + "}" * 5000,
        "NaN",
        "[Infinity]",
        "[1e999]",
        '{"a": -1e400}',
        "9" * 5000,
        '{"a": 9999999999999999999}',
        "[1" + "0" * 400 + ".0]",
        '"\\ud800"',
        "",
        "[1,]",
        "{} x",
    ],
)
def test_hostile_json_is_a_value_error(text):
    with pytest.raises(ValueError, match="."):
        parse_json(text)
    with pytest.raises(ValueError, match="."):
        parse_json(text.encode())


def test_a_number_out_of_range_is_named():
    with pytest.raises(ValueError, match=r"a\.1\.b = inf is not a finite number"):
        parse_json('{"a": [0, {"b": 1e999}]}')


def test_text_that_looks_like_a_large_number_is_text():
    text = "1e999 and 99999999999999999999"
    assert parse_json(json.dumps({"a": text})) == {"a": text}


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("a = " + "[" * 5000 + "]" * 5000, "deeper"),
        ("a = " + "[" * 50 + "]" * 50, "deeper"),
        ("a" + ".a" * 100_000 + " = 1", "dots"),
        ("[a" + ".a" * 100_000 + "]", "dots"),
        ("[a]\nb = inf", r"a\.b"),
        ("[a]\nb = -nan", r"a\.b"),
        ("[a]\nb = 1e999", r"a\.b"),
        ("[a]\nb = 99999999999999999999", r"a\.b"),
        ("[a]\nb = 1979-05-27", "date"),
        ("a = " + "9" * 5000, "."),
        ("a = \x1b", "."),
    ],
)
def test_hostile_toml_is_a_value_error(text, named):
    with pytest.raises(ValueError, match=named):
        parse_toml(text.encode())


def test_toml_that_is_no_utf_8_is_a_value_error():
    with pytest.raises(ValueError, match="utf-8"):
        parse_toml(b"\xff")
