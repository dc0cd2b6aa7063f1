"""Settings from TOML files and stored JSON. Every error is one line that names the place and what would be right."""

import dataclasses
import difflib
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from cutgrammar.errors import InputError
from cutgrammar.settings.all import Settings

T = TypeVar("T")


def load_settings(path: Path | None) -> Settings:
    """The default settings, changed by the TOML file at `path`, which has a table for each part, e.g. `[search]`.

    Raises:
        InputError: the file does not exist, is not TOML, or holds an unknown name or a value that is out of bounds.
    """
    return Settings() if path is None else from_tables(read_tables(path), str(path))


def read_tables(path: Path) -> dict[str, Any]:
    """The TOML file at `path` as nested dictionaries.

    Raises:
        InputError: the file does not exist or is not TOML.
    """
    try:
        return tomllib.loads(path.read_text())
    except FileNotFoundError:
        raise InputError(f"settings file {path} does not exist") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"settings file {path} cannot be read: {error}") from None


def from_tables(tables: Any, source: str) -> Settings:
    """Settings from nested dictionaries, as in a TOML file or a model's JSON.

    Args:
        tables: name of a table -> name of a setting -> value.
        source: what error messages call the place.

    Raises:
        InputError: an unknown name, or a value of another type or out of bounds.
    """
    return validated(Settings, tables, source)


def validated(cls: type[T], table: Any, source: str, prefix: str = "") -> T:
    """An object of the pydantic dataclass `cls` from a dictionary.

    Args:
        cls: the class; its fields carry their bounds.
        table: name of a field -> value.
        source: what error messages call the place, e.g. a file.
        prefix: put before the names of fields in error messages, e.g. "study.".

    Raises:
        InputError: an unknown or missing name, or a value of another type or out of bounds.
    """
    if not isinstance(table, dict):
        raise InputError(f"{source}: {prefix.removesuffix('.') or 'the top level'} must be a table, not {table!r}")
    try:
        return TypeAdapter(cls).validate_python(table)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise InputError(f"{source}: {_in_one_line(cls, first, prefix)}") from None


def closest(word: str, known: Iterable[str]) -> str:
    """A question that names the known word that `word` may be a misspelling of; empty if none is close."""
    close = difflib.get_close_matches(word, list(known), 1)
    return f"; did you mean {close[0]}?" if close else ""


def _in_one_line(cls: type, error: Any, prefix: str) -> str:
    """What pydantic says of one value, as: name, value, what would be right."""
    path = [part for part in error["loc"] if isinstance(part, str)]
    name, value, bounds = prefix + ".".join(path), error["input"], error.get("ctx", {})
    match error["type"]:
        case "unexpected_keyword_argument":
            known = [field.name for field in dataclasses.fields(_class_at(cls, path[:-1]))]
            return f"unknown setting {name}{closest(path[-1], known)} (known: {', '.join(known)})"
        case "missing" | "missing_argument":
            return f"{name} is missing"
        case "dataclass_type":
            return f"{name} must be a table, not {value!r}"
        case "too_short":
            return f"{name} is empty; at least one value is needed"
        case "greater_than_equal":
            return f"{name} = {value!r} is too small; the minimum is {bounds['ge']:g}"
        case "greater_than":
            return f"{name} = {value!r} is too small; it must be greater than {bounds['gt']:g}"
        case "less_than_equal":
            return f"{name} = {value!r} is too large; the maximum is {bounds['le']:g}"
        case "literal_error":
            return f"{name} = {value!r} is unknown; known: {bounds['expected'].replace(' or ', ', ')}"
        case "value_error":
            return f"{name}: {bounds['error']}" if name else str(bounds["error"])
    right = {
        "int_type": "a whole number",
        "float_type": "a number",
        "finite_number": "a finite number",
        "bool_type": "true or false",
        "string_type": "text in quotes",
        "tuple_type": "a list in square brackets",
    }
    return f"{name} = {value!r} is not {right.get(error['type'], 'valid: ' + error['msg'])}"


def _class_at(cls: Any, path: Iterable[str]) -> Any:
    """The dataclass of the field at `path` below the dataclass `cls`."""
    for name in path:
        cls = next(field.type for field in dataclasses.fields(cls) if field.name == name)
    return cls
