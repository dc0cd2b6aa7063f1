"""Pictures that several processes paint in turn: casting rays holds Python's lock, so threads would not help."""

from collections.abc import Callable, Iterator
from itertools import cycle
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from cutgrammar_dashboards.rendering.scene import Pixels

Painter = Callable[..., Iterator[Pixels]]
"""Called with a number, the number of painters and further arguments; paints every n-th picture from this one on."""


def in_turn(n: int, paint: Painter, arguments: tuple[Any, ...]) -> Iterator[Pixels]:
    """The pictures of `n` processes in their order; the processes end with the iteration.

    Args:
        n: number of processes.
        paint: a function of a module; each process calls it with its own number.
        arguments: its further arguments, which must be picklable.

    Raises:
        RuntimeError: a process died.
    """
    context = get_context("spawn")
    ends, painters = list[Connection](), []
    try:
        for number in range(n):
            ours, theirs = context.Pipe(duplex=False)
            painter = context.Process(target=_send, args=(theirs, number, n, paint, arguments), daemon=True)
            painter.start()
            theirs.close()
            ends.append(ours)
            painters.append(painter)
        for end in cycle(ends):
            try:
                pixels: Pixels | None = end.recv()
            except EOFError:
                raise RuntimeError("a process that paints a film has died") from None
            if pixels is None:
                return
            yield pixels
    finally:
        for painter in painters:
            painter.terminate()
            painter.join()


def _send(end: Connection, number: int, n: int, paint: Painter, arguments: tuple[Any, ...]) -> None:
    for pixels in paint(number, n, *arguments):
        end.send(pixels)
    end.send(None)
