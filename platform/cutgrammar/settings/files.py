"""Settings from TOML files and stored JSON. Every error is one line that names the place and what would be right."""

import dataclasses
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from cutgrammar.errors import InputError, closest, listed
from cutgrammar.settings.all import Settings
from cutgrammar.untrusted import parse_toml, read_regular, shortened
from cutgrammar.untrusted.documents import MAX_TOML

T = TypeVar("T")
RIGHT = {
    "int": "a whole number",
    "float": "a number",
    "finite": "a finite number",
    "bool": "true or false",
    "string": "text in quotes",
    "tuple": "a list in square brackets",
    "path": "a path",
}
"""What a value should have been, by the beginning of pydantic's name for the error."""


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
        return parse_toml(read_regular(path, MAX_TOML))
    except FileNotFoundError:
        raise InputError(f"settings file {path} does not exist") from None
    except InputError:
        raise
    except (OSError, ValueError) as error:
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
        raise InputError(
            f"{source}: {prefix.removesuffix('.') or 'the top level'} must be a table, not {shortened(table)}"
        )
    try:
        return TypeAdapter(cls).validate_json(json.dumps(table, default=str), strict=True)
    except ValidationError as error:
        raise InputError(f"{source}: {in_one_line(error, cls, prefix)}") from None
    except RecursionError:
        raise InputError(f"{source}: {prefix.removesuffix('.') or 'a setting'} is nested too deep") from None


def in_one_line(error: ValidationError, cls: type, prefix: str = "", option: bool = False) -> str:
    """The first thing that pydantic found wrong, in one line: the name, the value and what would be right.

    Args:
        error: raised when `cls` was built.
        cls: a pydantic dataclass.
        prefix: put before the name of a field.
        option: write the field as an option of the command line, e.g. `--max-rounds 0` for `max_rounds = 0`.
    """
    first: Any = error.errors(include_url=False)[0]
    path = [part for part in first["loc"] if isinstance(part, str)]
    value, bounds = first["input"], first.get("ctx", {})
    name = "--" + "-".join(path).replace("_", "-") if option else prefix + ".".join(path)
    given = f"{name} {value}" if option else f"{name} = {shortened(value)}"
    match first["type"]:
        case "unexpected_keyword_argument":
            at = _class_at(cls, path[:-1])
            if at is None:
                return f"unknown setting {name}"
            known = [field.name for field in dataclasses.fields(at)]
            return f"unknown setting {name}; known: {listed(known)}{closest(path[-1], known)}"
        case "missing" | "missing_argument" | "missing_keyword_only_argument":
            return f"{name} is missing"
        case "dataclass_type":
            return f"{name} must be a table, not {shortened(value)}"
        case "too_short":
            return f"{name} is empty; at least one value is needed"
        case "too_long" | "string_too_long":
            return f"{name} is too long; at most {bounds['max_length']} are possible"
        case "greater_than_equal":
            return f"{given} is too small; the minimum is {bounds['ge']:g}"
        case "greater_than":
            return f"{given} is too small; it must be greater than {bounds['gt']:g}"
        case "less_than_equal":
            return f"{given} is too large; the maximum is {bounds['le']:g}"
        case "less_than":
            return f"{given} is too large; it must be less than {bounds['lt']:g}"
        case "string_pattern_mismatch":
            return f"{given} has characters that it may not have"
        case "literal_error":
            known = bounds["expected"].replace("'", "").replace(" or ", ", ").split(", ")
            return f"{given} is unknown; known: {listed(known)}{closest(str(value), known)}"
        case "value_error":
            return str(bounds["error"])
    right = next((text for kind, text in RIGHT.items() if first["type"].startswith(kind)), f"valid: {first['msg']}")
    return f"{given} is not {right}"


def _class_at(cls: Any, path: Iterable[str]) -> Any:
    """The dataclass of the field at `path` below the dataclass `cls`; None if it is another type, such as a list."""
    for name in path:
        known = {field.name: field.type for field in dataclasses.fields(cls)}
        cls = known.get(name)
        if not dataclasses.is_dataclass(cls):
            return None
    return cls
