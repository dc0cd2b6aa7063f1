"""In what two requests differ, in a few words: for folders that were made with other settings than are given now."""

from collections.abc import Mapping
from typing import Any

from cutgrammar.atomic_files import json_bytes

LONGEST = 40
"""A longer text is a digest, of which the beginning is told."""


def first_difference(there: Mapping[str, Any], wanted: Mapping[str, Any]) -> str | None:
    """The first fact that differs, as "NAME = OLD, not NEW" with dots in names of nested ones; None if all are equal.

    Example:
        >>> first_difference({"seed": 0, "search": {"keys": 4}}, {"seed": 0, "search": {"keys": 8}})
        'search.keys = 4, not 8'
    """
    for name in [*wanted, *(name for name in there if name not in wanted)]:
        old, new = there.get(name), wanted.get(name)
        if json_bytes(old) == json_bytes(new):
            continue
        if isinstance(old, Mapping) and isinstance(new, Mapping):
            return f"{name}.{first_difference(old, new)}"
        return f"{name} = {_short(old)}, not {_short(new)}"
    return None


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= LONGEST else f"{text[:12]}..."
