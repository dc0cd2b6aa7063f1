"""The one place that parses JSON and TOML of strangers, with limits on size, nesting and numbers.

JSON is parsed by pydantic's parser, which refuses NaN, lone surrogates and more than 200 levels. Numbers beyond
64-bit integers and finite floating-point numbers are refused in both formats.
"""

import math
import re
import tomllib
from datetime import date, time
from pathlib import Path
from typing import Any

from pydantic_core import from_json

from cutgrammar.untrusted.files import read_regular

MAX_JSON = 64_000_000
"""Most bytes of a JSON file; the manifest of 100,000 trials with a part each has 40 MB."""
MAX_TOML = 4_500_000
"""Most bytes of a TOML file, which may hold the URDF of an arm."""
MAX_TOML_LEVELS = 12
_LONG = b"0" * 19
"""The digits of a whole number, each as 0, that may have more than 64 bits."""
_SHAPES = bytes.maketrans(b"123456789E", b"000000000e")
_MANY_DOTS = re.compile(r"(?:[\w\"'-]+[ \t]*\.[ \t]*){24}")
"""A dotted name so long that parsing it would take a time that grows with its square."""


def read_json(path: Path, limit: int = MAX_JSON) -> Any:
    """The JSON file at `path` as plain data.

    Raises:
        InputError: it is no ordinary file, or too large.
        OSError: it does not exist, or cannot be read.
        ValueError: see `parse_json`.
    """
    return parse_json(read_regular(path, limit))


def parse_json(content: bytes | str) -> Any:
    """JSON as plain data.

    Raises:
        ValueError: it is not JSON, nested deeper than 200 levels, or holds a number out of range.
    """
    data = from_json(content, allow_inf_nan=False, cache_strings="keys")
    if _may_be_beyond(content if isinstance(content, bytes) else content.encode()):
        _check_numbers(data, math.inf)
    return data


def parse_toml(content: bytes) -> dict[str, Any]:
    """TOML as nested dictionaries; dates and times are refused, since no setting is one.

    Raises:
        ValueError: it is not TOML, nested deeper than `MAX_TOML_LEVELS`, or holds a number out of range, or a date.
    """
    text = content.decode()
    if _MANY_DOTS.search(text):
        raise ValueError("a name in it has too many dots")
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise ValueError(f"it is nested deeper than {MAX_TOML_LEVELS} levels") from None
    _check_numbers(tables, MAX_TOML_LEVELS)
    return tables


def _may_be_beyond(content: bytes) -> bool:
    """Whether something in JSON looks like a number out of range; so does some text, which only costs time."""
    shape = content.translate(_SHAPES, b"+")
    at = shape.find(_LONG)
    while at >= 0:
        if shape[at - 1 : at] != b".":
            return True
        at = shape.find(_LONG, _end_of_digits(shape, at))  # a fraction can be as long as it likes
    at = shape.find(b"e000")
    while at >= 0:
        before = shape[max(0, at - 400) : at].rstrip(b"0.")  # digests hold e followed by digits, too
        if before[-1:] in b"-:,[ \t\r\n" and shape[at - 1 : at] in b"0.":
            return True
        at = shape.find(b"e000", at + 1)
    return False


def _end_of_digits(shape: bytes, at: int) -> int:
    """Where a run of digits ends, or somewhat before if it is very long."""
    digits = shape[at : at + 400]
    return at + len(digits) - len(digits.lstrip(b"0"))


def _check_numbers(data: Any, levels: float) -> None:
    """Refuse numbers out of range, dates, and more than so many levels, without recursion."""
    pending: list[tuple[Any, tuple[Any, str | int] | None, int]] = [(data, None, 0)]
    while pending:
        value, place, level = pending.pop()
        if isinstance(value, dict | list):
            if level > levels:
                raise ValueError(f"it is nested deeper than {levels} levels")
            items = value.items() if isinstance(value, dict) else enumerate(value)
            pending += [(inner, (place, name), level + 1) for name, inner in items]
        elif isinstance(value, float) and not math.isfinite(value):
            raise ValueError(f"{_name(place)} = {value} is not a finite number")
        elif isinstance(value, int) and not -(2**63) <= value < 2**63:
            raise ValueError(f"{_name(place)} is a whole number of more than 64 bits")
        elif isinstance(value, date | time):
            raise ValueError(f"{_name(place)} = {value} is a date or time; put text in quotes")


def _name(place: Any) -> str:
    """The dotted name of a place, given as (place above, name)."""
    parts: list[str] = []
    while place is not None:
        place, name = place
        parts.append(str(name))
    return ".".join(reversed(parts)) or "the value"
