"""The one error a user can cause: bad input. The command line prints it as one line and exits with code 2."""


class InputError(ValueError):
    """Something the user gave cannot be used.

    The message is one line that says what was wrong, the value, what would be right, and what to try.
    """


def one_of(name: str, value: str, known: list[str] | tuple[str, ...]) -> str:
    """Return `value` if it is among `known`.

    Raises:
        InputError: it is not; the message names the known values.
    """
    if value not in known:
        raise InputError(f"{name} {value!r} is unknown; known: {', '.join(known)}")
    return value
