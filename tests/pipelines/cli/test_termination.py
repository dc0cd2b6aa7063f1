"""Long commands that are ended by SIGTERM, at start and at work."""

import importlib
import os
import shlex
import signal
import subprocess
import sys
import time

import pytest

from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar_pipelines.cli.termination import terminable
from cutgrammar_pipelines.config import EvaluateConfig
from cutgrammar_pipelines.stages.evaluate import evaluate

METHODS = ["random", "largest", "copy"]


def test_sigterm_is_raised_once_and_the_handler_is_put_back():
    def work():
        try:
            os.kill(os.getpid(), signal.SIGTERM)
        finally:
            os.kill(os.getpid(), signal.SIGTERM)

    before = signal.getsignal(signal.SIGTERM)
    with terminable() as is_terminated:
        assert not is_terminated()
        with pytest.raises(KeyboardInterrupt):
            work()
        assert is_terminated()
    assert signal.getsignal(signal.SIGTERM) is before


def test_sigterm_within_an_import_waits_for_its_end(tmp_path, monkeypatch):
    text = "import os, signal, time\nos.kill(os.getpid(), signal.SIGTERM)\ntime.sleep(0.3)\nIS_WHOLE = True\n"
    (tmp_path / "ends_its_program.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)

    def work():
        importlib.import_module("ends_its_program")
        time.sleep(30)

    with terminable() as is_terminated, pytest.raises(KeyboardInterrupt):
        work()
    assert is_terminated()
    assert sys.modules.pop("ends_its_program").IS_WHOLE


def scores(run):
    return {record.key: record.scores for record in read_records(ledger_of(run))} if ledger_of(run).exists() else {}


@pytest.mark.slow
@pytest.mark.parametrize(("workers", "moments"), [(0, (0, 8)), (2, (0, 3))])
def test_an_evaluation_ended_by_sigterm_loses_nothing_and_says_how_to_resume(
    workers, moments, data_folder, model_folder, tmp_path
):
    folders = {"data": data_folder, "model": model_folder}
    evaluate(EvaluateConfig(**folders, out=tmp_path / "whole", methods=METHODS, world="bench", runs=1, workers=0))
    whole, run = scores(tmp_path / "whole"), tmp_path / "run"
    places = ["--data", str(data_folder), "--model", str(model_folder), "--out", str(run)]
    words = ["evaluate", *places, "--methods", *METHODS, "--world", "bench", "--runs", "1", "--workers", str(workers)]
    environment = os.environ | {"MLFLOW_TRACKING_URI": f"sqlite:///{tmp_path / 'mlflow.db'}"}
    kept = 0
    for wanted in moments:
        process = subprocess.Popen(
            [sys.executable, "-m", "cutgrammar_pipelines", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
        )
        end = time.monotonic() + 120
        while not run.exists() or (wanted and len(scores(run)) < kept + wanted):
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < end
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=120)
        assert process.returncode == 143, said
        again = shlex.join(["cutgrammar", *words])
        line = f"cutgrammar evaluate: terminated; run the same command again, it resumes: {again}"
        assert said.splitlines()[-1] == line
        assert "Traceback" not in said
        assert kept <= len(scores(run)) < len(whole)
        kept = len(scores(run))
    evaluate(EvaluateConfig(**folders, out=run, methods=METHODS, world="bench", runs=1, workers=0))
    assert scores(run) == whole
