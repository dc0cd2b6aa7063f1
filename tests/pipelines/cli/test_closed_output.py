"""Output whose reader has gone, such as `| head`: every command ends without a word, as Unix tools do."""

import contextlib
import os
import subprocess
import sys

import pytest

from cutgrammar_pipelines.cli.commands import COMMANDS
from cutgrammar_pipelines.cli.main import main
from cutgrammar_pipelines.stages.progress import progress


@pytest.fixture
def nobody():
    """The writing end of a pipe that nobody reads from."""
    reader, writer = os.pipe()
    os.close(reader)
    stream = os.fdopen(writer, "w", buffering=1)
    yield stream
    with contextlib.suppress(BrokenPipeError):
        stream.close()


@pytest.mark.parametrize("words", [*([command, "--help"] for command in COMMANDS), ["--help"], ["--version"]])
def test_every_command_is_quiet(words, nobody, monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdout", nobody)
    assert main(words) == 141
    nobody.flush()  # as at exit
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("words", [["collect"], ["show", "nothing"], ["bake"], []])
def test_refusals_are_quiet(words, nobody, monkeypatch, capsys):
    monkeypatch.setattr(sys, "stderr", nobody)
    assert main(words) == 141
    assert capsys.readouterr().out == ""


def test_results_are_quiet(data_folder, nobody, monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdout", nobody)
    assert main(["show", str(data_folder)]) == 141
    assert capsys.readouterr().err == ""


def test_a_connection_that_breaks_is_told(monkeypatch, capsys):
    def broken(_):
        raise BrokenPipeError(32, "Broken pipe")

    monkeypatch.setattr("cutgrammar_pipelines.inspection.doctor.doctor", lambda: broken(None))
    assert main(["doctor"]) == 1
    assert "Broken pipe" in capsys.readouterr().err


def test_progress_meets_it_in_the_main_thread(nobody, monkeypatch, capsys):
    monkeypatch.setattr(sys, "stderr", nobody)
    with pytest.raises(BrokenPipeError), progress("collect", 1, line_seconds=0.001) as advance:
        advance()
    monkeypatch.undo()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("redirection", ["| true", ">&- ", "2>&1 >/dev/null | true"])
def test_a_shell_sees_no_complaint(redirection, data_folder, tmp_path):
    line = f"'{sys.executable}' -m cutgrammar_pipelines show '{data_folder}' 2>'{tmp_path / 'errors'}' {redirection}"
    subprocess.run(["bash", "-c", line], check=True, stdout=subprocess.DEVNULL)
    assert (tmp_path / "errors").read_text() == ""
