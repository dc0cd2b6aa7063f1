import os

import numpy as np
import pytest
import trimesh

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.settings import DemonstratorSettings, Settings
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.split import read_split
from cutgrammar_pipelines.config import CollectConfig, SplitConfig
from cutgrammar_pipelines.stages import collect as module
from cutgrammar_pipelines.stages.collect import MeshFood
from cutgrammar_pipelines.stages.collect import collect as collect_as_in
from cutgrammar_pipelines.stages.splitting import split as split_as_in
from cutgrammar_workers.tasks import Crashed


def collect(out, **options):
    return collect_as_in(CollectConfig(out=out, **({"workers": 0} | options)))


def split(data, out, **options):
    return split_as_in(SplitConfig(data, out=out, **options))


def files(folder):
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out = tmp_path_factory.mktemp("collect") / "data"
    collect(out, trials=8, seed=3)
    return out


@pytest.fixture
def reversed_results(monkeypatch):
    """Results come in reverse order, as they might from many workers."""

    def run_all(worker, shared, tasks, on_result, workers, address=None, **_):
        results = [worker(shared)(task) for task in tasks]
        for index in reversed(range(len(tasks))):
            on_result(index, results[index])

    monkeypatch.setattr(module, "run_all", run_all)


def test_every_setup_is_cut_from_its_number_of_objects_into_its_categories(made):
    data = DataSet.open(made)
    assert len(data.trials) == 8
    for summary in data.trials:
        assert summary.setup == f"N{len(summary.foods)}M{len(summary.categories)}"
        assert summary.seed == 3
    assert data.foods["carrot"] == "cutgrammar_sim.foods:carrot"


def test_the_order_in_which_workers_finish_changes_no_byte(made, reversed_results, tmp_path):
    collect(tmp_path / "again", trials=8, seed=3)
    assert files(tmp_path / "again") == files(made)


@pytest.mark.slow
def test_the_number_of_workers_changes_no_byte(made, tmp_path):
    collect(tmp_path / "ray", trials=8, seed=3, workers=2)
    assert files(tmp_path / "ray") == files(made)


def test_another_seed_makes_other_demonstrations(made, tmp_path):
    collect(tmp_path / "other", trials=8, seed=4)
    first, second = DataSet.open(made).demonstration(0), DataSet.open(tmp_path / "other").demonstration(0)
    assert not np.array_equal(first.start[0].X_WF.to_vector(), second.start[0].X_WF.to_vector())


def test_repeating_a_request_does_nothing_and_says_so(made, monkeypatch, capsys):
    monkeypatch.setattr(module, "run_all", None)
    before = files(made)
    assert collect(made, trials=8, seed=3).digest == DataSet.open(made).digest
    assert files(made) == before
    assert "already holds this data set: 8 trials; nothing to do" in capsys.readouterr().out


@pytest.mark.parametrize(
    "request_",
    [
        {"trials": 9, "seed": 3},
        {"trials": 8, "seed": 4},
        {"trials": 8, "seed": 3, "setups": ["N1M1"]},
        {"trials": 8, "seed": 3, "foods": ["carrot"]},
        {"trials": 8, "seed": 3, "settings": Settings(demonstrator=DemonstratorSettings(offset_error=0.3))},
    ],
)
def test_another_request_into_the_same_folder_is_refused(made, request_):
    before = files(made)
    with pytest.raises(InputError, match=r"holds another data set \(8 trials, seed 3\); choose another --out"):
        collect(made, **request_)
    assert files(made) == before


def test_a_folder_with_other_things_in_it_is_refused_before_any_work(tmp_path, monkeypatch):
    (tmp_path / "notes.txt").write_text("mine")
    monkeypatch.setattr(module, "run_all", None)
    with pytest.raises(InputError, match="exists already"):
        collect(tmp_path, trials=8)


def test_a_demonstrator_that_fails_leaves_no_data_set_and_names_the_trial(tmp_path, monkeypatch):
    def run_all(worker, shared, tasks, on_result, workers, address=None, **_):
        on_result(0, worker(shared)(tasks[0]))
        on_result(2, Crashed("ValueError: no", 'File "a/b.py", line 1, in f\nFile "a/food.py", line 7, in g\nno'))

    monkeypatch.setattr(module, "run_all", run_all)
    message = (
        r"^trial 2 \(\w+ in setup N1M1\) could not be demonstrated: ValueError: no \(food\.py, line 7\); leave out .*$"
    )
    with pytest.raises(InputError, match=message):
        collect(tmp_path / "data", trials=8)
    assert os.listdir(tmp_path) == []


def test_trials_that_wait_for_an_earlier_one_are_loaded_again_when_its_turn_comes(made, tmp_path, monkeypatch):
    """Only so many are in memory, whatever the order in which workers finish."""

    def run_all(worker, shared, tasks, on_result, *_, **__):
        for index in (5, 3, 6, 1, 0, 7, 4, 2):
            on_result(index, worker(shared)(tasks[index]))

    loaded = []
    load = module.BegunDataSet.load
    monkeypatch.setattr(module.BegunDataSet, "load", lambda self, trial: loaded.append(trial) or load(self, trial))
    monkeypatch.setattr(module, "run_all", run_all)
    monkeypatch.setattr(module, "MAX_WAITING", 2)
    collect(tmp_path / "data", trials=8, seed=3)
    assert loaded == [1, 4, 6, 7]
    assert files(tmp_path / "data") == files(made)


@pytest.mark.parametrize("damage", [False, True])
def test_an_interrupted_collection_resumes_with_the_same_bytes(damage, made, tmp_path, monkeypatch):
    """The trials that were made are not made again, unless their files are damaged."""
    out = tmp_path / "data"

    def until_interrupted(worker, shared, tasks, on_result, *_, **__):
        for index in (1, 0, 4):
            on_result(index, worker(shared)(tasks[index]))
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(module, "run_all", until_interrupted)
        with pytest.raises(KeyboardInterrupt):
            collect(out, trials=8, seed=3)
    assert not out.exists()
    (begun,) = tmp_path.iterdir()
    if damage:
        next((begun / "4" / "cuts").iterdir()).write_bytes(b"torn")
    made_now = []

    def run_all(worker, shared, tasks, on_result, *_, **__):
        made_now.extend(task.trial for task in tasks)
        for index, task in enumerate(tasks):
            on_result(index, worker(shared)(task))

    monkeypatch.setattr(module, "run_all", run_all)
    collect(out, trials=8, seed=3)
    assert made_now == ([2, 3, 4, 5, 6, 7] if damage else [2, 3, 5, 6, 7])
    assert files(out) == files(made)
    assert os.listdir(tmp_path) == ["data"]


def test_two_collections_of_one_data_set_do_not_meet(tmp_path, monkeypatch):
    def run_all(*_, **__):
        with pytest.raises(InputError, match="another process is making"):
            collect(tmp_path / "data", trials=8, seed=3)
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "run_all", run_all)
    with pytest.raises(KeyboardInterrupt):
        collect(tmp_path / "data", trials=8, seed=3)
    assert os.listdir(tmp_path) == []


def test_a_users_meshes_can_be_cut(tmp_path):
    mesh = trimesh.creation.capsule(height=0.1, radius=0.025, count=(8, 12))
    mesh.export(tmp_path / "scan.stl")
    data = collect(tmp_path / "data", trials=3, setups=["N1M1", "N2M1"], foods=[str(tmp_path / "scan.stl"), "carrot"])
    assert set(data.foods) == {"scan", "carrot"}
    assert data.foods["scan"].startswith("sha256:")
    assert {food for summary in data.trials for food in summary.foods} <= {"scan", "carrot"}


def test_a_mesh_food_ignores_its_stream(rng):
    box = trimesh.creation.box((0.1, 0.05, 0.04))
    food = MeshFood(Mesh(box.vertices, box.faces))
    assert food(rng) is food(rng)


def test_requests_that_cannot_be_met_are_refused_in_one_line(tmp_path):
    for wrong, message in (
        ({"trials": 3}, "3 trials are too few for 6 setups, .* give --trials 6 or more, .* --setups N1M1 N1M2 N2M1$"),
        ({"foods": ["carot"]}, "food 'carot' is unknown; known: apple, aubergine, banana, block, carrot"),
        ({"foods": ["carrot", "carrot"]}, "two foods are called 'carrot'"),
        ({"foods": ["a/scan.stl", "b/scan.ply"]}, "scan.stl"),
    ):
        with pytest.raises(InputError, match=message) as caught:
            collect(tmp_path / "data", **wrong)
        assert "\n" not in str(caught.value)
    assert os.listdir(tmp_path) == []


# --- splitting --------------------------------------------------------------------------------------------------------


def test_a_split_is_written_into_its_data_set(made, capsys):
    assert split([made], made) == read_split(DataSet.open(made))
    assert "paper.json: 1 trials train, 7 test" in capsys.readouterr().out
    assert split([made], made, rule="share").rule == "share"


def test_several_data_sets_become_one_and_repeating_it_changes_nothing(made, tmp_path):
    other = tmp_path / "other"
    collect(other, trials=4, seed=5, setups=["N1M1"])
    made_split = split([made, other], tmp_path / "both")
    both = DataSet.open(tmp_path / "both")
    assert [summary.seed for summary in both.trials] == [3] * 8 + [5] * 4
    assert sorted(made_split.train + made_split.test) == list(range(12))
    before = files(tmp_path / "both")
    assert split([made, other], tmp_path / "both") == made_split
    assert files(tmp_path / "both") == before
    with pytest.raises(InputError, match="exists already"):
        split([other, made], tmp_path / "both")
    with pytest.raises(InputError, match="is one of the data sets to merge"):
        split([made, other], other)
