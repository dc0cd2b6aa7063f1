"""Commands that join a Ray cluster, whose nodes have what is installed and not what the driver has."""

import pytest

from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar_pipelines.cli.main import main

WHERE = """
import cutgrammar
from cutgrammar import Method


class Teller:
    def next_cut(self, *_):
        raise RuntimeError(f"cutgrammar is {cutgrammar.__file__}, the plugin {__file__}")


TELLER = Method("teller", lambda context: Teller())
"""
"""A method that says where its code and that of the platform are."""


@pytest.fixture
def cluster(monkeypatch, tmp_path):
    """A cluster of one node with two CPUs; yields its address."""
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path / 'mlflow.db'}")
    from ray.cluster_utils import Cluster

    started = Cluster(initialize_head=True, head_node_args={"num_cpus": 2, "include_dashboard": False})
    yield started.address
    started.shutdown()


@pytest.mark.slow
def test_code_and_plugins_reach_nodes_that_have_neither(cluster, install, data_folder, model_folder, tmp_path, capsys):
    install("teller", WHERE, methods={"teller": "TELLER"})
    places = ["--data", str(data_folder), "--model", str(model_folder), "--out", str(tmp_path / "run")]
    once = ["--setups", "N1M1", "--trials", "2", "--runs", "1", "--world", "bench", "--address", cluster]
    evaluate = ["evaluate", *places, *once, "--methods", "teller", "random"]
    assert main(evaluate) == 2
    assert "teller:TELLER cannot be loaded" in (error := capsys.readouterr().err)
    assert "send it with --py-module" in error
    assert main([*evaluate, "--py-module", str(tmp_path / "site-teller" / "teller.py")]) == 0
    records = read_records(ledger_of(tmp_path / "run"))
    assert [record.status for record in records if record.key.method == "random"] == ["done", "done"]
    told = [record.reason for record in records if record.key.method == "teller"]
    assert len(told) == 2
    for reason in told:
        assert reason.count("py_modules_files") == 2, reason
