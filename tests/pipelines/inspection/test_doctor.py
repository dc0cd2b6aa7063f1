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
    said = capsys.readouterr().out
    assert "torch       1.0" in said
    assert "missing" not in said
    assert "secret" not in said


def test_a_missing_package_is_reported_with_the_command_that_installs_it(complete, monkeypatch, capsys):
    def version(package):
        if package == "ray":
            raise PackageNotFoundError(package)
        return "1.0"

    monkeypatch.setattr(doctor, "version", version)
    assert doctor.doctor() == 1
    assert "ray         missing: pip install ray" in capsys.readouterr().out
