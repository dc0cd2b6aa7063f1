"""The one place that makes text printable: what strangers wrote must not command a terminal, nor flood it."""

import re
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from typing import Any, TextIO

_UNPRINTABLE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)
"""Control characters but tabs and line ends, and what reverses text or cannot be encoded."""
MAX_VALUE = 80
MAX_LINE = 1_000


def printable(text: str) -> str:
    """The text with control characters written as escapes, such as \\x1b; line ends and tabs stay."""
    return _UNPRINTABLE.sub(lambda found: found.group().encode("unicode_escape").decode(), text)


def one_line(text: str) -> str:
    """The text as one printable line, without the middle if it is long."""
    line = printable(" ".join(text.splitlines()))
    return line if len(line) <= MAX_LINE else f"{line[: MAX_LINE // 2]} ... {line[-MAX_LINE // 2 :]}"


def shortened(value: Any) -> str:
    """A value as messages show it: its beginning, if it is long."""
    if isinstance(value, str | bytes):
        return repr(value) if len(value) <= MAX_VALUE else f"{value[:MAX_VALUE]!r}..."
    if isinstance(value, list | tuple | dict) and len(value) > MAX_VALUE:
        return f"a {type(value).__name__} of {len(value)}"
    if isinstance(value, int) and not -(2**63) <= value < 2**64:
        return "a whole number of more than 64 bits"
    try:
        text = repr(value)
    except RecursionError:
        return f"a {type(value).__name__} nested too deep"
    return text if len(text) <= MAX_VALUE else f"{text[:MAX_VALUE]}..."


class PrintableStream:
    """A text stream that escapes what is written to another."""

    def __init__(self, stream: TextIO) -> None:
        self.raw = stream

    def write(self, text: str) -> int:
        """Write the text, with control characters as escapes."""
        self.raw.write(printable(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.raw, name)


@contextmanager
def printing_safely(out: TextIO | None, err: TextIO | None) -> Iterator[None]:
    """Within the block, what Python prints to the streams of this process has no control characters."""
    safe: list[Any] = [None if stream is None else PrintableStream(stream) for stream in (out, err)]
    with redirect_stdout(safe[0]), redirect_stderr(safe[1]):
        yield


def unescaped(stream: TextIO) -> TextIO:
    """The stream below a `PrintableStream`, for libraries that draw on terminals and escape what they are given."""
    return stream.raw if isinstance(stream, PrintableStream) else stream
