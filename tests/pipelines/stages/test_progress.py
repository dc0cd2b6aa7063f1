import io
import time

import pytest
from rich.console import Console

from cutgrammar_pipelines.stages.progress import progress


def test_without_a_terminal_it_prints_plain_lines_while_nothing_moves_and_one_at_the_end():
    out = io.StringIO()
    with progress("collect", 5, done=1, console=Console(file=out), line_seconds=0.02) as advance:
        advance()
        time.sleep(0.2)
        advance(3)
    lines = out.getvalue().splitlines()
    assert len(lines) >= 3
    assert lines[0].startswith("collect: 2 of 5, ")
    assert lines[-1].startswith("collect: 5 of 5")


def test_on_a_terminal_it_draws_a_bar():
    out = io.StringIO()
    with progress("train [x]", 4, console=Console(file=out, force_terminal=True, width=100)) as advance:
        advance(4)
    assert "train [x]" in out.getvalue()
    assert "4/4" in out.getvalue()


def test_an_error_inside_ends_it_with_what_was_done():
    out = io.StringIO()

    def fails_after_two():
        with progress("collect", 5, console=Console(file=out)) as advance:
            advance(2)
            raise RuntimeError("halfway")

    with pytest.raises(RuntimeError, match="halfway"):
        fails_after_two()
    assert [line.split(",")[0] for line in out.getvalue().splitlines()] == ["collect: 2 of 5"]
