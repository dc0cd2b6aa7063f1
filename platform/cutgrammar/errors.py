"""The one error that a user can cause: bad input. The command line prints it as one line and exits with code 2."""

import difflib
from collections.abc import Iterable

LISTED = 8
"""Names that a message lists before it only counts them."""


class InputError(ValueError):
    """Something that the user gave cannot be used.

    The message is one line: what is wrong, the value, what would be right, and what to try.
    """


def one_of(name: str, value: str, known: list[str] | tuple[str, ...]) -> str:
    """Return `value` if it is among `known`.

    Raises:
        InputError: it is not; the message names the known values and the closest of them.
    """
    if value not in known:
        raise InputError(f"{name} {value!r} is unknown; known: {listed(known)}{closest(value, known)}")
    return value


def listed(names: Iterable[object], at_most: int = LISTED) -> str:
    """The names with commas between them; if they are many, the first `at_most`, and how many more there are."""
    words = [str(name) for name in names]
    if len(words) <= at_most + 1:  # a single name takes no more room than its count
        return ", ".join(words)
    return f"{', '.join(words[:at_most])} and {len(words) - at_most} more"


def closest(word: str, known: Iterable[str]) -> str:
    """A question that names the known word of which `word` may be a misspelling; empty if none is close."""
    close = difflib.get_close_matches(word, list(known), 1)
    return f"; did you mean {close[0]}?" if close else ""
