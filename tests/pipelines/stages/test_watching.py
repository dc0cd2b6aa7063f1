"""The commands with --watch, shown in a real viewer."""

import numpy as np
import pytest

import viewers
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar_pipelines.cli.main import main


@pytest.mark.slow
def test_a_watched_evaluation_is_in_the_viewer_and_has_the_records_of_one_that_is_not(
    data_folder, model_folder, tmp_path, monkeypatch
):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path}/mlflow.db")
    words = [
        "evaluate",
        "--data",
        str(data_folder),
        "--model",
        str(model_folder),
        "--methods",
        "halve",
        "--world",
        "bench",
    ]
    words += ["--setups", "N1M1", "--runs", "1", "--trials", "2", "--workers", "0"]
    with viewers.headless_viewer(tmp_path) as (url, client):
        assert main([*words, "--out", str(tmp_path / "watched"), "--watch", url]) == 0
        wanted = {"Worker 1", "Worker 1: fragments", "Goal", "Parse tree", "Scores so far", "What happens"}
        views = viewers.views_with(client, wanted, 60)
        assert wanted <= {view.name for view in views}
        picture = client.take_screenshot()
    assert np.frombuffer(picture, dtype=np.uint8).std() > 1
    assert main([*words, "--out", str(tmp_path / "unwatched")]) == 0
    watched, unwatched = (read_records(ledger_of(tmp_path / name)) for name in ("watched", "unwatched"))
    assert [record.digest for record in watched] == [record.digest for record in unwatched]
    assert len(watched) == 2
