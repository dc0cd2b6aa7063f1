"""What a command says while it works: one live line a stage, status lines and notes; `--quiet` silences all of it.

On a terminal a stage has one live line with its rate, the time left and how many items failed so far; otherwise a plain
line says the same every half minute and at the end. Results and problems are printed by whoever has them.
"""

import logging
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from typing import Any, Protocol

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from cutgrammar.command_lines import as_typed
from cutgrammar.untrusted import printable
from cutgrammar.untrusted.printing import unescaped

Watch = Callable[[str, int, int], Any]
"""Called with the name of a stage, the number of its items that are done, and their total."""

_IS_QUIET: ContextVar[bool] = ContextVar("is_quiet", default=False)


class Advance(Protocol):
    """Counts items as done."""

    def __call__(self, n: int = 1, failed: int = 0) -> None:
        """`n` further items are done, of which `failed` did not end as they should."""
        ...


@contextmanager
def quietly(is_quiet: bool = True) -> Iterator[None]:
    """Within the block nothing is said but results and problems, if `is_quiet`."""
    before, simulation = _IS_QUIET.set(is_quiet), logging.getLogger("cutgrammar_sim")
    level = simulation.level
    simulation.setLevel(logging.ERROR if is_quiet else level)
    try:
        yield
    finally:
        simulation.setLevel(level)
        _IS_QUIET.reset(before)


def status(text: str) -> None:
    """Print what has been done or comes next, which is no result, to standard output."""
    if not _IS_QUIET.get():
        print(printable(as_typed(text)))


def note(text: str) -> None:
    """Print what a user should know, and need not act on, to standard error."""
    if not _IS_QUIET.get():
        print(printable(as_typed(text)), file=sys.stderr)


@contextmanager
def progress(
    task: str, total: int, done: int = 0, console: Console | None = None, line_seconds: float = 30.0
) -> Iterator[Advance]:
    """Show the progress of `task` on standard error while the block runs.

    Args:
        task: name shown, e.g. "collect".
        total: total number of items.
        done: number of items done before.
        console: output, standard error by default.
        line_seconds: time between two plain lines [s].

    Example:
        >>> with progress("collect", 2) as advance:
        ...     advance()
        ...     advance(failed=1)
    """
    if _IS_QUIET.get():
        yield _say_nothing
        return
    console = console or Console(file=sys.stderr and unescaped(sys.stderr), stderr=True)
    show = _live_line if console.is_terminal else _plain_lines
    with show(console, task, total, done, line_seconds) as advance:
        yield advance


@contextmanager
def stages(console: Console | None = None) -> Iterator[Watch]:
    """A line for each stage that the yielded function is called with; it ends when the next stage begins."""
    with ExitStack() as line:
        stage, so_far = "", 0
        advance: Advance = _say_nothing

        def watch(name: str, done: int, total: int) -> None:
            nonlocal stage, so_far, advance
            if name != stage:
                line.pop_all().close()
                stage, so_far = name, 0
                advance = line.enter_context(progress(name, total, console=console))
            advance(done - so_far)
            so_far = done

        yield watch


def _say_nothing(n: int = 1, failed: int = 0) -> None:
    """An `Advance` that shows nothing."""


class _Rate(ProgressColumn):
    """Items a second, or seconds an item."""

    def render(self, task: Task) -> Text:
        return Text(_rate(task.finished_speed or task.speed), style="progress.data.speed")


class _Failed(ProgressColumn):
    """How many items failed; nothing if none did."""

    def render(self, task: Task) -> Text:
        return Text(_failures(int(task.fields["failed"])), style="red")


@contextmanager
def _live_line(console: Console, task: str, total: int, done: int, _: float) -> Iterator[Advance]:
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=20),
        MofNCompleteColumn(),
        _Rate(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        _Failed(),
    )
    with Progress(*columns, console=console) as shown:
        row = shown.add_task(task, total=total, completed=done, failed=0)
        failures = 0

        def advance(n: int = 1, failed: int = 0) -> None:
            nonlocal failures
            failures += failed
            shown.update(row, advance=n, failed=failures)

        yield advance


@contextmanager
def _plain_lines(console: Console, task: str, total: int, done: int, line_seconds: float) -> Iterator[Advance]:
    began, count, failures, over = time.monotonic(), done, 0, threading.Event()

    def advance(n: int = 1, failed: int = 0) -> None:
        nonlocal count, failures
        count, failures = count + n, failures + failed

    def print_line() -> None:
        seconds = time.monotonic() - began
        rate = (count - done) / seconds if seconds > 0 else 0.0
        left = f"{(total - count) / rate:.0f} s left" if rate and count < total else ""
        parts = (f"{task}: {count} of {total}", f"{seconds:.0f} s", _rate(rate), left, _failures(failures))
        print(", ".join(filter(None, parts)), file=console.file, flush=True)  # rich would end the program if this fails

    def watch() -> None:
        while not over.wait(line_seconds):
            with suppress(BrokenPipeError):  # the main thread meets it, too
                print_line()

    watcher = threading.Thread(target=watch, name=f"progress of {task}", daemon=True)
    watcher.start()
    try:
        yield advance
    finally:
        over.set()
        watcher.join()
        print_line()


def _rate(per_second: float | None) -> str:
    if not per_second:
        return ""
    return f"{per_second:.1f}/s" if per_second >= 1.0 else f"{1.0 / per_second:.1f} s each"


def _failures(number: int) -> str:
    return f"{number} failed" if number else ""
