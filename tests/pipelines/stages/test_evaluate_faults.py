"""Faults of methods, of the machine and of the driver cost their own trials only."""

import os
import re
import signal
import socket
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from cutgrammar.errors import InputError
from cutgrammar.settings import Settings, TrialSettings
from cutgrammar.storage.ledger import read_attempts, read_records
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar_pipelines.cli.main import main
from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.reports.text import as_text
from cutgrammar_pipelines.tracking import mlflow_store
from quick_runs import QUICK, digests, run_quick

CLUMSY = """
from cutgrammar import Method


class Clumsy:
    def next_cut(self, now, goal, refused, rng):
        raise ArithmeticError("cannot count")


CLUMSY = Method("clumsy", lambda _: Clumsy())
"""


def test_a_method_that_crashes_still_has_its_rows(given, run, install):
    install("clumsy", CLUMSY, methods={"clumsy": "CLUMSY"})
    summary = run_quick(given, run, methods=["random", "clumsy"])
    assert summary.complete
    assert (summary.failed, summary.crashed) == (0, 1)
    assert "1 crashed" in str(summary)
    crashed = [record for record in read_records(ledger_of(run)) if record.status == "crashed"]
    assert {record.reason for record in crashed} == {"ArithmeticError: cannot count"}


ENDLESS = """
from cutgrammar import Method


class Endless:
    def next_cut(self, now, goal, refused, rng):
        while True:
            try:
                pass
            except Exception:
                pass


ENDLESS = Method("endless", lambda _: Endless())
"""


def test_a_method_that_never_ends_costs_its_own_trials_only(given, run, install):
    install("endless", ENDLESS, methods={"endless": "ENDLESS"})
    settings = Settings(trial=TrialSettings(max_seconds=2.0))
    summary = run_quick(given, run, methods=["random", "endless"], settings=settings)
    assert summary.complete
    assert "1 out of time" in str(summary)
    rows = {record.key.method: record for record in read_records(ledger_of(run))}
    assert rows["random"].status != "timeout"
    late = rows["endless"]
    assert (late.status, late.iou_strict) == ("timeout", 0.0)
    assert late.reason == "it was stopped after 2 s, 2 times (trial.max_seconds)"


POISON = """
import ctypes
import os
import signal

import numpy as np

from cutgrammar import Cut, Method, Plane, Stuck
from cutgrammar.errors import InputError

UP = Plane(np.array([0.0, 0.0, 1.0]), 0.0)


def fail(error):
    raise error


ACTIONS = {
    "none": lambda: None,
    "thing": lambda: object(),
    "surrogate": lambda: Stuck("a\\ud800"),
    "long": lambda: Stuck("x" * 10**8),
    "nan": lambda: Cut(UP, np.full((1, 3), np.nan)),
    "single": lambda: Cut(UP, np.zeros((1, 3), dtype=np.float32)),
    "input": lambda: fail(InputError("the mesh is open")),
    "leave": lambda: fail(SystemExit(0)),
    "fork": lambda: Stuck(f"{os.fork() >= 0}"),
    "exit": lambda: os._exit(0),
    "segfault": lambda: ctypes.string_at(0),
    "suicide": lambda: os.kill(os.getpid(), signal.SIGKILL),
}


class Poison:
    def __init__(self, name):
        self.name = name

    def next_cut(self, now, goal, refused, rng):
        return ACTIONS[self.name]()


def method(name):
    return Method(name, lambda _: Poison(name))


"""
POISONS = (
    "none",
    "thing",
    "surrogate",
    "long",
    "nan",
    "single",
    "input",
    "leave",
    "fork",
    "exit",
    "segfault",
    "suicide",
)
DEADLY = {"exit": "exited with code 0", "segfault": "was ended by SIGSEGV", "suicide": "was ended by SIGKILL"}


@pytest.fixture
def command(given, run, monkeypatch):
    """The command that evaluates one trial with each method, without MLflow; gives its exit code."""

    def evaluate(methods, workers):
        words = ["evaluate", "--data", given / "data", "--model", given / "model", "--out", run, "--methods", *methods]
        words += ["--setups", "N1M1", "--runs", 1, "--trials", 1, "--world", "bench", "--workers", workers]
        return main(list(map(str, words)))

    monkeypatch.setattr(mlflow_store, "log_evaluation", lambda *_, **__: True)
    return evaluate


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_poisonous_plugins_end_their_own_trials_only(run, install, command, workers, monkeypatch, capsys):
    lines = "".join(f'{name.upper()} = method("{name}")\n' for name in POISONS)
    install("poison", POISON + lines, methods={name: name.upper() for name in POISONS})
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))  # for the workers
    assert command(["random", *POISONS], workers) == 0
    said = capsys.readouterr().out
    assert "13 of 13 trials have a record, 13 of them new" in said
    assert "faults of the machine" not in said
    rows = {record.key.method: record for record in read_records(ledger_of(run))}
    assert rows["random"].status != "crashed"
    crashed = {name for name, record in rows.items() if record.status == "crashed"}
    assert crashed == {"none", "thing", "nan", "input", "leave", *DEADLY}
    for name, ending in DEADLY.items():
        where = rf"its process died 3 times: process \d+ on {socket.gethostname()} {ending}$"
        assert re.match(where, rows[name].reason), rows[name].reason
    assert command(["random", *POISONS], workers) == 0
    assert "already finished: all 13 trials have a record" in capsys.readouterr().out


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_a_world_that_hangs_at_its_import_ends_the_command_with_one_line(
    run, install, given, workers, monkeypatch, capsys
):
    install("sleepy", "import time\ntime.sleep(600.0)\n", worlds={"sleepy": "WORLD"})
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))  # for the workers
    words = ["evaluate", "--data", given / "data", "--model", given / "model", "--out", run, "--methods", "random"]
    words += ["--world", "sleepy", "--workers", workers, "--max-start-seconds", 2]
    assert main(list(map(str, words))) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if "built" in line]
    assert len(said) == 1
    assert re.search(
        r"a worker was not built within 2 s, and was at \S+/sleepy\.py:2\b.*; see what hangs there", said[0]
    )


UNLUCKY = """
import errno
import os
import subprocess
import time
from pathlib import Path

from cutgrammar import Method, Stuck


class Unlucky:
    def next_cut(self, now, goal, refused, rng):
        trial = int(rng.integers(2**40))
        hits = len(list(Path(FOLDER).glob(f"{trial}-*")))
        if hits == 3:
            return Stuck("tired")
        Path(FOLDER, f"{trial}-{hits}").touch()
        match (trial + hits) % 3:
            case 0:
                subprocess.run(["/bin/kill", "-KILL", str(os.getpid())])
                time.sleep(60.0)
            case 1:
                raise MemoryError
            case 2:
                raise OSError(errno.ENOSPC, "no space left")


UNLUCKY = Method("unlucky", lambda _: Unlucky())
"""


@pytest.mark.slow
@pytest.mark.parametrize(("workers", "trials"), [(0, 20), (2, 4)])
def test_of_trials_that_the_machine_hit_three_times_each_none_has_crashed(
    given, run, install, workers, trials, tmp_path, monkeypatch
):
    hits = tmp_path / "hits"
    hits.mkdir()
    install("unlucky", f"FOLDER = {str(hits)!r}\n{UNLUCKY}", methods={"unlucky": "UNLUCKY"})
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))  # for the workers
    summary = run_quick(given, run, methods=["unlucky"], runs=trials, workers=workers)
    assert (summary.complete, summary.crashed, summary.stuck, summary.timeout) == (True, 0, trials, 0)
    assert len(list(hits.iterdir())) == 3 * trials
    told = read_attempts(ledger_of(run)).superseded["infrastructure"]
    assert summary.faults == told
    # In company a death says nothing: its tasks are tried again, alone, and then every fault is told.
    assert (told == 3 * trials) if workers == 0 else (2 * trials <= told <= 3 * trials)
    assert f"{told} attempts ended by faults of the machine" in str(summary)
    assert "fault of the machine: repeated, and no score" in as_text(build_report([run]))
    assert "fault of the machine" not in as_text(build_report([run], timing=False))


def test_a_fault_of_the_machine_is_no_score(given, run, install, command, capsys):
    install(
        "hungry",
        CLUMSY.replace('ArithmeticError("cannot count")', "MemoryError()").replace('"clumsy"', '"hungry"'),
        methods={"hungry": "CLUMSY"},
    )
    summary = run_quick(given, run, methods=["random", "hungry"])
    assert (summary.planned, summary.present, summary.new, summary.complete) == (2, 1, 1, False)
    assert [record.key.method for record in read_records(ledger_of(run))] == ["random"]
    assert "has no record, for the machine failed: MemoryError" in capsys.readouterr().err
    assert summary.faults == 5
    assert run_quick(given, run, methods=["random", "hungry"], failure_budget=2).faults == 2
    assert command(["random", "hungry"], 0) == 1


@pytest.mark.slow
def test_a_killed_evaluation_resumes_and_ends_like_an_undisturbed_one(given, run, tmp_path):
    options = {"data": str(given / "data"), "model": str(given / "model"), "out": str(run), "runs": 12, "workers": 1}
    options = QUICK | options
    program = textwrap.dedent(
        f"""
        from cutgrammar_pipelines import EvaluateConfig, evaluate
        evaluate(EvaluateConfig(**{options!r}))
        """
    )
    with subprocess.Popen([sys.executable, "-c", program]) as driver:
        while not ledger_of(run).exists() or rows(run) < 3:
            assert driver.poll() is None, "it ended before it could be killed"
            time.sleep(0.05)
        os.kill(driver.pid, signal.SIGKILL)
    kept = digests(run)
    assert 3 <= len(kept) < 12
    subprocess.run([sys.executable, "-c", program], check=True)
    run_quick(given, tmp_path / "undisturbed", runs=12)
    assert digests(run) == digests(tmp_path / "undisturbed")
    assert kept.items() <= digests(run).items()


def rows(run: Path) -> int:
    try:
        return len(read_records(ledger_of(run)))
    except InputError:  # it is being written
        return 0
