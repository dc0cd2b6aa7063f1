"""People as a method: their reproductions are scored, those of test robots enter no table."""

import dataclasses
import json

import numpy as np
import pytest

from cutgrammar.demonstration import PERSON, ROBOT, DemonstratedCut
from cutgrammar.errors import InputError
from cutgrammar.learning.model import save_model
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.growing import add_trial
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.manifest import Manifest, reproduction_of
from cutgrammar.storage.run_folder import ledger_of, read_run
from cutgrammar.storage.split import make_split, read_split, write_split
from cutgrammar.trials.scoring import score
from cutgrammar_pipelines.config import CollectConfig, EvaluateConfig, ShowConfig
from cutgrammar_pipelines.inspection.show import show
from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.reports.text import as_text
from cutgrammar_pipelines.stages.collect import collect
from cutgrammar_pipelines.stages.evaluate import evaluate
from cutgrammar_pipelines.stages.evaluate.reproduce import reproduce_trial
from cutgrammar_pipelines.stages.rate import pool_of
from object_store import object_store, upload
from untrained_model import untrained


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """A folder with a small data set, its split and a model."""
    folder = tmp_path_factory.mktemp("given")
    data = collect(CollectConfig(out=folder / "data", trials=8, setups=["N1M1", "N1M2"], workers=0))
    split = make_split(data)
    write_split(data, split)
    save_model(untrained(data, split), folder / "model")
    return folder


def goals(given):
    data = DataSet.open(given / "data")
    return [data.demonstration(trial) for trial in sorted(read_split(data).test)]


def without_the_last_cut(demonstration):
    """What somebody made who stopped one cut early."""
    *kept, last = demonstration.cuts
    shorter = {key: pose for key, pose in demonstration.poses.items() if key[0] < last.step}
    fragments = tuple(f for f in demonstration.fragments if f.step < last.step)
    return dataclasses.replace(demonstration, cuts=tuple(kept), poses=shorter, fragments=fragments)


def with_one_cut_more(demonstration):
    """What somebody made who did not stop: a fragment of the goal is halved."""
    from cutgrammar.geometry.canonical import canonical_frame
    from cutgrammar.geometry.plane import Plane
    from cutgrammar.geometry.slicing import slice_mesh

    step = demonstration.steps
    alive = demonstration.alive(step)
    cut = max(alive, key=lambda i: demonstration.fragments[i].mesh.volume)
    whole, X_WF = demonstration.fragments[cut], demonstration.poses[step, cut]
    plane_F = Plane.through(whole.mesh.centroid, np.array([0.6, 0.8, 0.0]))
    ids = range(len(demonstration.fragments), len(demonstration.fragments) + 2)
    products = [
        dataclasses.replace(whole, id=i, parent=cut, step=step + 1, mesh=mesh)
        for i, mesh in zip(ids, slice_mesh(whole.mesh, plane_F).products, strict=True)
    ]
    poses = {(step + 1, i): demonstration.poses[step, i] for i in alive if i != cut}
    made = DemonstratedCut(
        step + 1,
        plane_F.transformed(X_WF),
        plane_F.transformed(canonical_frame(whole.mesh).inverse()),
        cut,
        tuple(ids),
    )
    before = tuple(dataclasses.replace(f, category=None) if f.id == cut else f for f in demonstration.fragments)
    return dataclasses.replace(
        demonstration,
        fragments=(*before, *products),
        poses={**demonstration.poses, **poses, **{(step + 1, i): X_WF for i in ids}},
        cuts=(*demonstration.cuts, made),
    )


def reproduced(folder, given, work, who=PERSON):
    """A data set as `record --reproduce` makes it."""
    folder.mkdir(parents=True)
    digest = DataSet.open(given / "data").digest
    facts = Manifest(None, 0, reproduction_of(digest), {}, (), ())
    for number, made in enumerate(work):
        add_trial(folder, dataclasses.replace(made, demonstrator=f"{who} P{number}"), facts)
    return folder


def run(given, out, **changes):
    config = {"data": given / "data", "model": given / "model", "out": out, "methods": ["human"], "world": "bench"}
    return evaluate(EvaluateConfig(**(config | {"workers": 0} | changes)))


def test_people_are_scored_by_what_they_saved_on_the_goals_that_they_did(given, tmp_path, capsys):
    first, second, third, *_ = wanted = goals(given)
    work = [first, without_the_last_cut(second), with_one_cut_more(third)]
    people = reproduced(tmp_path / "people", given, work)
    summary = run(given, tmp_path / "run", human=[people])
    assert (summary.planned, summary.present) == (3, 3)
    assert f"people: 3 of {len(wanted)} goals reproduced, 3 times in all" in capsys.readouterr().out
    records = read_records(ledger_of(tmp_path / "run"))
    for made, goal, record in zip(work, wanted, records, strict=False):
        assert record.iou_strict == pytest.approx(score(made.goal, goal.goal).scores["iou_strict"], abs=1e-6)
        assert record.fragments == len(made.goal)
        assert record.status == "done"
    assert records[0].iou_strict == pytest.approx(1.0, abs=1e-6)
    again = reproduce_trial(tmp_path / "run", records[1].key).record
    assert again.digest == records[1].digest


def test_people_in_an_object_store_are_those_of_a_folder(given, tmp_path, monkeypatch):
    people = reproduced(tmp_path / "people", given, goals(given)[:2])
    run(given, tmp_path / "beside", human=[people])
    monkeypatch.setenv("CUTGRAMMAR_CACHE", str(tmp_path / "cache"))
    with object_store(monkeypatch):
        upload(given / "data", "s3://lab/data")
        upload(people, "s3://lab/people")
        run(given, tmp_path / "run", human=["s3://lab/people"], data="s3://lab/data")
        records, same = (read_records(ledger_of(tmp_path / name)) for name in ("run", "beside"))
        assert [record.digest for record in records] == [record.digest for record in same]
        assert len(records) == 2
        assert read_run(tmp_path / "run").human == ("s3://lab/people",)
        assert read_run(tmp_path / "beside").human == (str(people),)
        assert reproduce_trial(tmp_path / "run", records[0].key).record.digest == records[0].digest
        with pytest.raises(InputError, match="s3://lab/data does not hold reproductions of the goals of s3://lab/data"):
            run(given, tmp_path / "other", human=["s3://lab/data"], data="s3://lab/data")


def test_tables_say_how_many_goals_people_did_beside_methods_that_did_all(given, tmp_path):
    wanted = goals(given)
    people = reproduced(tmp_path / "people", given, wanted[:2])
    run(given, tmp_path / "people-run", human=[people])
    run(given, tmp_path / "run", methods=["halve"])
    report = build_report([tmp_path / "run", tmp_path / "people-run"])
    rows = {row["method"]: row for row in report.numbers["rows"] if row["setup"] == "all"}
    assert (rows["human"]["trials"], rows["halve"]["trials"]) == (2, len(wanted))
    assert rows["human"]["seconds_mean"] is None
    text = as_text(report)
    assert "human §" in text
    assert "Fewer trials than n: human § has" in text
    assert any(term == "§" for term, _ in report.glossary)


def test_a_goal_that_several_people_did_counts_once_with_their_mean(given, tmp_path):
    first, second, *_ = goals(given)
    one = reproduced(tmp_path / "one", given, [first, second])
    other = reproduced(tmp_path / "other", given, [without_the_last_cut(first)])
    run(given, tmp_path / "run", human=[one, other], methods=["human", "halve"])
    keys = [record.key for record in read_records(ledger_of(tmp_path / "run")) if record.key.method == "human"]
    assert sorted((key.trial, key.run) for key in keys) == [(first.trial, 0), (first.trial, 1), (second.trial, 0)]
    (entry,) = [
        row
        for row in build_report([tmp_path / "run"]).numbers["rows"]
        if (row["method"], row["setup"]) == ("human", "all")
    ]
    short = score(without_the_last_cut(first).goal, first.goal).scores["iou_strict"]
    assert entry["iou_strict_mean"] == pytest.approx(((1.0 + short) / 2 + 1.0) / 2, abs=1e-6)
    assert (entry["trials"], entry["runs"], entry["iou_strict_std_runs"]) == (2, 1, None)


def test_what_a_test_robot_did_is_left_out_and_where_it_is_asked_for_no_table_takes_it(given, tmp_path, capsys):
    first, second, third, *_ = goals(given)
    mixed = reproduced(tmp_path / "mixed", given, [first, second])
    digest = reproduction_of(DataSet.open(given / "data").digest)
    robot = dataclasses.replace(third, demonstrator=f"{ROBOT} P9")
    add_trial(mixed, robot, Manifest(None, 0, digest, {}, (), ()))
    run(given, tmp_path / "run", human=[mixed])
    assert "NOTE 1 reproductions were made by a test robot and are left out" in capsys.readouterr().err
    assert len(read_records(ledger_of(tmp_path / "run"))) == 2
    assert build_report([tmp_path / "run"]).numbers["rows"]

    run(given, tmp_path / "test", human=[mixed], test_robots=True)
    assert len(read_records(ledger_of(tmp_path / "test"))) == 3
    assert read_run(tmp_path / "test").by_robot
    with pytest.raises(InputError, match="what a test robot did, which enters no table"):
        build_report([tmp_path / "run", tmp_path / "test"])
    with pytest.raises(InputError, match="what a test robot did, which enters no table"):
        show(ShowConfig(tmp_path / "test", out=tmp_path / "pictures"))
    assert not (tmp_path / "pictures").exists()
    with pytest.raises(InputError, match="what a test robot did, which enters no table"):
        pool_of([tmp_path / "test"])
    only_robots = reproduced(tmp_path / "robots", given, [first], ROBOT)
    with pytest.raises(InputError, match="no person made a reproduction"):
        run(given, tmp_path / "none", human=[only_robots])


def test_the_mark_of_a_robot_cannot_be_taken_off(given, tmp_path):
    robots = reproduced(tmp_path / "robots", given, goals(given)[:1], ROBOT)
    run(given, tmp_path / "test", human=[robots], test_robots=True)
    file = tmp_path / "test" / "run.json"
    facts = json.loads(file.read_text())
    assert facts.pop("by_robot") is True
    file.write_text(json.dumps(facts))
    with pytest.raises(InputError, match="put a good copy"):
        build_report([tmp_path / "test"])


def test_requests_that_do_not_fit_say_what_to_do(given, tmp_path):
    people = reproduced(tmp_path / "people", given, goals(given)[:1])
    with pytest.raises(InputError, match="cutgrammar record --reproduce .*, as --human FOLDER"):
        run(given, tmp_path / "run")
    with pytest.raises(InputError, match="add human to --methods"):
        run(given, tmp_path / "run", methods=["halve"], human=[people])
    with pytest.raises(InputError, match="does not hold reproductions of the goals of"):
        run(given, tmp_path / "run", human=[given / "data"])
    with pytest.raises(InputError, match="is given twice"):
        run(given, tmp_path / "run", human=[people, people])
    with pytest.raises(InputError, match="human cannot be evaluated on scattered goals"):
        run(given, tmp_path / "run", human=[people], goals=["scattered"])
    assert not (tmp_path / "run").exists()


def test_without_people_a_run_is_what_it_was_before_there_were_any(given, tmp_path):
    run(given, tmp_path / "run", methods=["halve"])
    facts = json.loads((tmp_path / "run" / "run.json").read_text())
    assert not {"human", "human_digests", "by_robot"} & set(facts)
