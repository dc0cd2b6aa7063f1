"""Commands in messages can be typed as they are printed, whether or not the PATH has the program."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
from functools import partial
from pathlib import Path

import pytest

from cutgrammar import command_lines
from cutgrammar.command_lines import COMMANDS, as_typed, command_line, program
from cutgrammar.errors import InputError, listed, one_of
from cutgrammar_pipelines.cli.commands import COMMANDS as KNOWN
from cutgrammar_pipelines.cli.main import main

SCRIPTS = Path(sysconfig.get_path("scripts"))


def off_the_path(monkeypatch):
    monkeypatch.setenv("PATH", "/usr/bin:/bin")


def test_commands_in_messages_are_those_that_exist():
    assert list(COMMANDS) == list(KNOWN)


def test_on_the_path_the_name_is_enough():
    assert program() == "cutgrammar"
    assert command_line("view", Path("my run"), "N1M1-0") == "cutgrammar view 'my run' N1M1-0"


def test_off_the_path_commands_have_the_path_from_the_current_folder(monkeypatch, tmp_path):
    off_the_path(monkeypatch)
    monkeypatch.chdir(SCRIPTS.parent.parent)
    short = f"{SCRIPTS.parent.name}/{SCRIPTS.name}"
    assert program() == f"{short}/cutgrammar"
    monkeypatch.chdir(tmp_path)
    assert command_line("report", "run") == f"{SCRIPTS}/cutgrammar report run"


def test_another_installation_on_the_path_is_not_meant(monkeypatch, tmp_path):
    other = tmp_path / "cutgrammar"
    other.write_text("#!/bin/sh\n")
    other.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    monkeypatch.chdir(tmp_path)
    assert program() == f"{SCRIPTS}/cutgrammar"


def test_programs_installed_beside_it_have_its_path(monkeypatch, tmp_path):
    for name in ("cutgrammar", "rerun"):
        (tmp_path / name).write_text("#!/bin/sh\n")
        (tmp_path / name).chmod(0o755)
    monkeypatch.setattr(sys, "argv", [str(tmp_path / "cutgrammar")])
    monkeypatch.chdir(tmp_path.parent)
    assert program("rerun") == f"{tmp_path.name}/rerun"
    assert program("ffmpeg") == "ffmpeg"


def test_a_path_with_spaces_is_quoted(monkeypatch, tmp_path):
    folder = tmp_path / "my tools"
    folder.mkdir()
    shutil.copy(SCRIPTS / "cutgrammar", folder)
    monkeypatch.setattr(sys, "argv", [str(folder / "cutgrammar"), "view"])
    monkeypatch.chdir(tmp_path)
    assert command_line("view", "run") == "'my tools/cutgrammar' view run"
    assert as_typed(command_line("view", "run")) == "'my tools/cutgrammar' view run"


def test_without_a_script_the_module_is_run(monkeypatch, tmp_path):
    monkeypatch.setattr(command_lines, "_folder", lambda: tmp_path)
    assert program() == f"{sys.executable} -m cutgrammar_pipelines"


def test_only_commands_in_prose_are_replaced(monkeypatch):
    off_the_path(monkeypatch)
    monkeypatch.chdir(SCRIPTS.parent)
    path = f"{SCRIPTS.name}/cutgrammar"
    told = "cutgrammar split makes one (see cutgrammar --help); written by cutgrammar 0.2, a cutgrammar trajectory"
    expected = f"{path} split makes one (see {path} --help); written by cutgrammar 0.2, a cutgrammar trajectory"
    assert as_typed(told) == expected
    assert as_typed(expected) == expected


@pytest.mark.parametrize("words", [["show", "nothing"], ["split", "nothing", "--out", "x"], ["collect"], ["--help"]])
def test_what_the_program_prints_names_it_as_it_can_be_typed(words, monkeypatch, capsys):
    off_the_path(monkeypatch)
    monkeypatch.chdir(SCRIPTS.parent)
    main(words)
    out, err = capsys.readouterr()
    told = out.split("\n", 1)[-1] if out else err.split(": ", 1)[1]
    mentions = re.findall(rf"(\S*)cutgrammar (?:{'|'.join(COMMANDS)})\b", told)
    assert set(mentions) <= {f"{SCRIPTS.name}/", f"({SCRIPTS.name}/"}, told


def test_the_advice_of_a_started_program_works_as_printed(tmp_path):
    """Started by its path, as `make demo` does; the command that a refusal names is then run by a shell."""
    environment = {**os.environ, "PATH": "/usr/bin:/bin"}
    outside = partial(subprocess.run, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    advice = re.search(r"\(see (.*)\)", outside([str(SCRIPTS / "cutgrammar"), "collect"]).stderr)[1]
    told = outside(advice, shell=True)
    assert (told.returncode, told.stderr) == (0, "")
    assert "--trials" in told.stdout


def test_long_lists_name_the_first_and_count_the_rest():
    assert listed("abc") == "a, b, c"
    assert listed(range(9)) == "0, 1, 2, 3, 4, 5, 6, 7, 8"
    assert listed(range(40)) == "0, 1, 2, 3, 4, 5, 6, 7 and 32 more"
    assert listed([]) == ""
    with pytest.raises(InputError, match="unknown; known: 0, 1, .* and 32 more; did you mean 3?"):
        one_of("number", "3x", [str(number) for number in range(40)])
