"""The first difference of two requests, in a few words, for folders that were made with other settings."""

from collections.abc import Mapping
from typing import Any

from cutgrammar.atomic_files import json_bytes

MAX_LENGTH = 40
"""Longer texts are digests, of which only the beginning is given."""


def first_difference(existing: Mapping[str, Any], wanted: Mapping[str, Any]) -> str | None:
    """The first fact that differs, as "NAME = OLD, not NEW" with dots in names of nested ones; None if all are equal.

    Example:
        >>> first_difference({"seed": 0, "search": {"keys": 4}}, {"seed": 0, "search": {"keys": 8}})
        'search.keys = 4, not 8'
    """
    for name in [*wanted, *(name for name in existing if name not in wanted)]:
        old, new = existing.get(name), wanted.get(name)
        if json_bytes(old) == json_bytes(new):
            continue
        if isinstance(old, Mapping) and isinstance(new, Mapping):
            return f"{name}.{first_difference(old, new)}"
        return f"{name} = {_short(old)}, not {_short(new)}"
    return None


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= MAX_LENGTH else f"{text[:12]}..."
