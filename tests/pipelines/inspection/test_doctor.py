from importlib.metadata import PackageNotFoundError

import pytest

from cutgrammar_pipelines.inspection import doctor


@pytest.fixture
def complete(monkeypatch):
    """A machine where everything works."""
    monkeypatch.setattr(doctor, "_works", lambda code: True)
    monkeypatch.setattr(doctor, "version", lambda package: "1.0")


def test_a_complete_machine_lacks_nothing_and_passwords_are_not_shown(complete, monkeypatch, capsys):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://me:secret@server:5000")
    assert doctor.doctor() == 0
    text = capsys.readouterr().out
    assert "torch       1.0" in text
    assert "missing" not in text
    assert "secret" not in text


def test_a_missing_package_is_reported_with_the_command_that_installs_it(complete, monkeypatch, capsys):
    def version(package):
        if package == "ray":
            raise PackageNotFoundError(package)
        return "1.0"

    monkeypatch.setattr(doctor, "version", version)
    assert doctor.doctor() == 1
    assert "ray         missing: pip install ray" in capsys.readouterr().out


@pytest.mark.parametrize("code", ["raise SystemExit(1)", "import os; os.abort()", "import time; time.sleep(60)"])
def test_a_driver_that_fails_crashes_or_hangs_does_not_work(code):
    assert not doctor._works(code, seconds=2.0)
