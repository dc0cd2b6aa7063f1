"""The first thing that is wrong is told in one line that names the field."""

from typing import Annotated, Literal

import pytest
from pydantic import Field, TypeAdapter, with_config
from typing_extensions import TypedDict

from cutgrammar.untrusted import check
from cutgrammar.untrusted.kinds import STRICT, Small, Word, fixed


@with_config(STRICT)
class Inner(TypedDict):
    word: Word
    three: fixed(float, 3)


@with_config(STRICT)
class Outer(TypedDict):
    count: Small
    kind: Literal["a", "b"] | None
    inner: list[Inner]
    names: Annotated[dict[Word, bool], Field(max_length=2)]


GOOD = {"count": 1, "kind": None, "inner": [{"word": "x y", "three": [0.0, 1, 2]}], "names": {"n": True}}


def test_what_fits_passes():
    check(TypeAdapter(Outer), GOOD)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"count": -1}, "count = -1 is below 0"),
        ({"count": 1.0}, "count = 1.0 is not a whole number"),
        ({"count": True}, "count = True is not a whole number"),
        ({"count": "1"}, "count = '1' is not a whole number"),
        ({"count": 10**400}, "count = a whole number of more than 64 bits"),
        ({"kind": "c"}, "kind = 'c' is not one of 'a', 'b'"),
        ({"inner": {}}, "inner = {} is not a list"),
        ({"inner": [None]}, r"inner\[0\] = None is not a table"),
        ({"inner": [{"word": "../x", "three": [0.0] * 3}]}, r"inner\[0\]\.word = '\.\./x' has characters"),
        ({"inner": [{"word": "x", "three": [0.0] * 4}]}, r"inner\[0\]\.three = .* is longer than 3"),
        (
            {"inner": [{"word": "x", "three": [0.0, float("nan"), 0.0]}]},
            r"inner\[0\]\.three\[1\] = nan is not a finite",
        ),
        ({"inner": [{"word": "x"}]}, r"inner\[0\]\.three is missing"),
        ({"names": {"a": 1}}, "names.a = 1 is neither true nor false"),
        ({"names": {"a": True, "b": True, "c": True}}, "names = .* is longer than 2"),
        ({"other": 1}, "other is unknown"),
    ],
)
def test_what_is_wrong_is_named(change, line):
    with pytest.raises(ValueError, match=f"^{line}"):
        check(TypeAdapter(Outer), GOOD | change)
