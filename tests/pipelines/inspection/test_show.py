"""What `show` tells: of runs in which an arm made the cuts, and of what is in an object store."""

import pytest

from cutgrammar.errors import InputError
from cutgrammar_pipelines.cli.main import main
from cutgrammar_pipelines.config import ShowConfig
from cutgrammar_pipelines.inspection.show import show
from object_store import object_store, upload


@pytest.fixture
def store(monkeypatch, tmp_path):
    monkeypatch.setenv("CUTGRAMMAR_CACHE", str(tmp_path / "cache"))
    with object_store(monkeypatch) as stop:
        yield stop


def test_a_run_of_an_arm_tells_how_it_cut(arm_run, capsys):
    assert show(ShowConfig(arm_run)) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-2:] == [
        "  arm of kinova, truth, grammar: 1 cuts in 4 s simulated, 0 % moved first, 0 % turned",
        "    at worst: plane off by 0.010 degrees and 0.020 mm, torque 60 % and velocity 40 % of their limits, 25 N on "
        "the blade; all limits kept",
    ]


def test_a_run_without_an_arm_says_nothing_of_one(scored_run, capsys):
    assert show(ShowConfig(scored_run)) == 0
    assert "arm of" not in capsys.readouterr().out


def test_what_is_in_an_object_store_is_described_as_in_a_folder(
    store, data_folder, model_folder, scored_run, tmp_path, capsys
):
    for kind, folder in {"data": data_folder, "model": model_folder, "run": scored_run}.items():
        upload(folder, f"s3://lab/{kind}")
        assert main(["show", str(folder)]) == 0
        told = capsys.readouterr().out
        assert main(["show", f"s3://lab/{kind}"]) == 0
        assert capsys.readouterr().out == told.replace(str(folder), f"s3://lab/{kind}")
        assert f"s3://lab/{kind}, " in told.replace(str(folder), f"s3://lab/{kind}")


def test_a_model_in_an_object_store_is_drawn_with_its_data_there(store, data_folder, model_folder, tmp_path):
    upload(data_folder, "s3://lab/data")
    upload(model_folder, "s3://lab/model")
    with pytest.raises(InputError, match=r"s3://lab/model was trained on .* name it with --data"):
        show(ShowConfig("s3://lab/model", out=tmp_path / "grammar.png"))
    with pytest.raises(InputError, match=r"^s3://lab/nothing holds no files"):
        show(ShowConfig("s3://lab/model", out=tmp_path / "grammar.png", data="s3://lab/nothing"))
    assert show(ShowConfig("s3://lab/model", out=tmp_path / "store", data="s3://lab/data")) == 0
    assert show(ShowConfig(model_folder, out=tmp_path / "folder", data=data_folder)) == 0
    drawn = [(tmp_path / kind / "grammar.png").read_bytes() for kind in ("store", "folder")]
    assert drawn[0] == drawn[1]
    assert drawn[0].startswith(b"\x89PNG")


def test_a_url_that_holds_none_of_the_three_is_told_in_one_line(store, tmp_path, capsys):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "file").write_text("x")
    upload(tmp_path / "other", "s3://lab/other")
    assert main(["show", "s3://lab/other"]) == 2
    assert capsys.readouterr().err == (
        "cutgrammar show: s3://lab/other has neither manifest.json, model.json nor run.json; give a data set, a model "
        "or a run\n"
    )
    assert main(["show", "s3://lab/nothing"]) == 2
    assert capsys.readouterr().err.startswith("cutgrammar show: s3://lab/nothing holds no files")
