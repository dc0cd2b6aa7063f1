"""Progress of a long task: a bar on a terminal, otherwise a plain line every half minute."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

Advance = Callable[..., None]
"""`advance()` counts one item as done, `advance(n)` counts n."""


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
        ...     advance()
    """
    console = console or Console(stderr=True)
    show = _bar if console.is_terminal else _lines
    with show(console, task, total, done, line_seconds) as advance:
        yield advance


@contextmanager
def _bar(console: Console, task: str, total: int, done: int, _: float) -> Iterator[Advance]:
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as bar:
        row = bar.add_task(task, total=total, completed=done)
        yield lambda n=1: bar.advance(row, n)


@contextmanager
def _lines(console: Console, task: str, total: int, done: int, line_seconds: float) -> Iterator[Advance]:
    began, count, over = time.monotonic(), done, threading.Event()

    def advance(n: int = 1) -> None:
        nonlocal count
        count += n

    def print_line() -> None:
        seconds = time.monotonic() - began
        console.print(f"{task}: {count} of {total}, {seconds:.0f} s", markup=False, highlight=False, soft_wrap=True)

    def watch() -> None:
        while not over.wait(line_seconds):
            print_line()

    watcher = threading.Thread(target=watch, name=f"progress of {task}", daemon=True)
    watcher.start()
    try:
        yield advance
    finally:
        over.set()
        watcher.join()
        print_line()
