import io
import os
import pty
import subprocess
import sys
import time

import pytest
from rich.console import Console

from cutgrammar_pipelines.cli.main import main
from cutgrammar_pipelines.stages.progress import note, progress, quietly, stages, status


def test_without_a_terminal_it_prints_plain_lines_while_nothing_moves_and_one_at_the_end():
    out = io.StringIO()
    with progress("collect", 5, done=1, console=Console(file=out), line_seconds=0.02) as advance:
        advance()
        time.sleep(0.2)
        advance(3, failed=2)
    lines = out.getvalue().splitlines()
    assert len(lines) >= 3
    assert lines[0].startswith("collect: 2 of 5, ")
    assert lines[0].endswith(" s left")
    assert lines[-1].startswith("collect: 5 of 5")
    assert lines[-1].endswith("2 failed")
    assert "failed" not in lines[0]


def test_an_error_inside_ends_it_with_what_was_done():
    out = io.StringIO()

    def fails_after_two():
        with progress("collect", 5, console=Console(file=out)) as advance:
            advance(2)
            raise RuntimeError("halfway")

    with pytest.raises(RuntimeError, match="halfway"):
        fails_after_two()
    assert [line.split(",")[0] for line in out.getvalue().splitlines()] == ["collect: 2 of 5"]


def test_every_stage_has_a_line_of_its_own():
    out = io.StringIO()
    with stages(Console(file=out)) as watch:
        for name, done in (("types", 1), ("types", 2), ("planes", 1)):
            watch(name, done, 2)
    assert [line.split(",")[0] for line in out.getvalue().splitlines()] == ["types: 2 of 2", "planes: 1 of 2"]


WORK = """
import time
from cutgrammar_pipelines.stages.progress import progress
with progress("evaluate [x]", 4) as advance:
    for failed in (0, 1, 1, 0):
        time.sleep(0.15)
        advance(failed=failed)
        print("a note")
"""


def test_on_a_terminal_one_live_line_counts_failures_and_stays_whole_among_notes():
    """A process whose standard streams are a pseudo-terminal."""
    ours, theirs = pty.openpty()
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "120"}
    process = subprocess.Popen([sys.executable, "-c", WORK], stdout=theirs, stderr=theirs, env=environment)
    os.close(theirs)
    seen = b""
    while True:
        try:
            read = os.read(ours, 65536)
        except OSError:  # the process has closed its end
            break
        if not read:
            break
        seen += read
    os.close(ours)
    assert process.wait() == 0
    text = seen.decode()
    assert "4/4" in text
    assert "2 failed" in text
    assert "left" in text
    lines = screen(text)
    assert [line for line in lines if line == "a note"] == ["a note"] * 4
    (live,) = [line for line in lines if line.startswith("evaluate [x]")]
    assert "4/4" in live
    assert live.endswith("2 failed")


def screen(text):
    """What is on the terminal at the end: understands what moves the cursor up and erases a line."""
    lines, row, column = [""], 0, 0
    rest = text
    while rest:
        if rest.startswith("\x1b["):
            end = next(i for i, c in enumerate(rest[2:], start=2) if c.isalpha())
            number, letter = rest[2:end], rest[end]
            if letter == "A":
                row -= int(number or 1)
            elif letter == "K":
                lines[row] = ""
            rest = rest[end + 1 :]
            continue
        sign, rest = rest[0], rest[1:]
        if sign == "\r":
            column = 0
        elif sign == "\n":
            row, column = row + 1, 0
            lines += [""] * (row + 1 - len(lines))
        else:
            lines[row] = lines[row].ljust(column)[:column] + sign + lines[row][column + 1 :]
            column += 1
    return [line.rstrip() for line in lines]


def test_quietly_nothing_is_said(capsys):
    with quietly():
        with progress("collect", 2) as advance:
            advance(2, failed=1)
        status("done")
        note("look")
    assert capsys.readouterr() == ("", "")
    status("done")
    note("look")
    assert capsys.readouterr() == ("done\n", "look\n")


def collect_into(out):
    return ["collect", "--out", str(out), "--trials", "1", "--setups", "N1M1", "--workers", "0"]


@pytest.mark.parametrize("place", [0, 1, 5])
def test_quiet_commands_print_results_and_problems_only(place, tmp_path, scored_run, capsys):
    collecting = [
        "collect",
        "--out",
        str(tmp_path / f"data{place}"),
        "--trials",
        "1",
        "--setups",
        "N1M1",
        "--workers",
        "0",
    ]
    collecting.insert(place, "--quiet")
    assert main(collecting) == 0
    assert capsys.readouterr() == ("", "")
    assert main(["report", str(scored_run), "--quiet"]) == 0
    out, err = capsys.readouterr()
    assert "Over all setups" in out
    assert err == ""
    assert main(["report", str(tmp_path / "nothing"), "--quiet"]) == 2
    assert "is not a run" in capsys.readouterr().err


def test_without_quiet_the_same_commands_say_how_far_they_are(tmp_path, scored_run, capsys):
    assert main(collect_into(tmp_path / "data")) == 0
    out, err = capsys.readouterr()
    assert "holds 1 trials" in out
    assert err.startswith("collect: 1 of 1")
    assert main(["report", str(scored_run)]) == 0
    assert capsys.readouterr().err.startswith("report: ")
