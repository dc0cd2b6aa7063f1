"""Checks plain data against a schema; the first thing that is wrong is told in one line that names the field."""

from typing import Any

import orjson
from pydantic import TypeAdapter, ValidationError

from cutgrammar.untrusted.printing import shortened

_WRONG = {
    "missing": "is missing",
    "extra_forbidden": "is unknown",
    "finite_number": "is not a finite number",
    "int_type": "is not a whole number",
    "int_from_float": "is not a whole number",
    "float_type": "is not a number",
    "string_type": "is not text",
    "bool_type": "is neither true nor false",
    "list_type": "is not a list",
    "dict_type": "is not a table",
    "string_pattern_mismatch": "has characters that it may not have",
}
_NO_VALUE = ("missing", "extra_forbidden")


def check(schema: "TypeAdapter[Any]", data: Any) -> None:
    """Check plain data.

    Raises:
        ValueError: they do not fit; the message is one line that names the field, its value and what is wrong.
    """
    try:
        schema.validate_python(data)
    except ValidationError as error:
        raise ValueError(problem_in(error)) from None


def parse_exact(schema: "TypeAdapter[Any]", content: bytes) -> Any:
    """JSON as plain data, faster than by `parse_json` and `check`; None if it does not fit or has unknown names.

    Args:
        schema: it bounds every number, so that none out of range can pass.
        content: of the file.
    """
    try:
        data = orjson.loads(content)
        schema.validate_python(data, extra="forbid")
    except (orjson.JSONDecodeError, ValidationError):
        return None
    return data


def problem_in(error: ValidationError) -> str:
    """The first thing that pydantic found wrong, in one line."""
    first: Any = error.errors(include_url=False)[0]
    kind, bounds, value = first["type"], first.get("ctx", {}), shortened(first["input"])
    name = _name([part for part in first["loc"] if not _is_branch(part)])
    if kind in _NO_VALUE:
        return f"{name} {_WRONG[kind]}"
    match kind:
        case "greater_than_equal":
            wrong = f"is below {bounds['ge']:g}"
        case "greater_than":
            wrong = f"is not above {bounds['gt']:g}"
        case "less_than_equal":
            wrong = f"is above {bounds['le']:g}"
        case "less_than":
            wrong = f"is not below {bounds['lt']:g}"
        case "literal_error":
            wrong = f"is not one of {bounds['expected'].replace(' or ', ', ')}"
        case "too_short" | "string_too_short":
            wrong = f"is shorter than {bounds['min_length']}"
        case "too_long" | "string_too_long":
            wrong = f"is longer than {bounds['max_length']}"
        case "value_error":
            wrong = f"is wrong: {bounds['error']}"
        case _:
            wrong = _WRONG.get(kind) or f"is wrong: {first['msg']}"
    return f"{name} = {value} {wrong}"


def _is_branch(part: str | int) -> bool:
    """Whether a part of a place is pydantic's name for one of several schemas, and no name in the data."""
    return isinstance(part, str) and (
        part.startswith(("function-", "list[", "dict[", "constrained-", "lax-or-")) or part in ("[key]", "nullable")
    )


def _name(place: list[str | int]) -> str:
    text = ""
    for part in place:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text or "the file"
