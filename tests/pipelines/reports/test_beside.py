"""Two runs side by side: paired differences of the trials that both have."""

import json
from dataclasses import replace

import pytest

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.results.score_table import Row
from cutgrammar.results.side_by_side import Side, SideBySide
from cutgrammar.storage.configurations import TrialConfigurations
from cutgrammar.storage.ledger import Ledger
from cutgrammar.storage.run_folder import ledger_of, settle_run
from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.reports.text import as_text
from report_rows import row


@pytest.fixture
def write(made, tmp_path, lump, random_pose):
    """Writes a run whose strict IoU are those of the other runs plus `gain`."""
    pose = random_pose()

    def make(name, gain, **changes):
        facts = made.facts_of(**changes)
        run = tmp_path / name / "run"
        settle_run(run, facts)
        with Ledger(ledger_of(run)) as ledger:
            for one in made.records_of(made.facts_of(), methods=["grammar", "random"]):
                scores = {"iou": 0.3, "iou_strict": one.scores["iou_strict"] + gain}
                key = replace(one.key, origin=facts.origin)
                event = made.scored_event([[0, 0, 0.5]])
                fragment = (Fragment(lump, pose),)
                ledger.add(
                    replace(one, key=key, scores=scores, events=(event,)),
                    TrialConfigurations(fragment, fragment, fragment),
                )
        return run

    return make


def test_the_difference_is_that_of_the_same_trials(write):
    first, second = write("first", 0.0), write("second", 0.05, seed=101)
    report = build_report([first], beside=[second])
    beside = report.to_json()["beside"]
    assert (beside["first"], beside["second"]) == ("first/run", "second/run")
    overall = [entry for entry in beside["rows"] if entry["setup"] == "all" and entry["score"] == "iou_strict"]
    assert [entry["method"] for entry in overall] == ["grammar", "random"]
    for entry in overall:
        assert entry["trials"] == 6
        assert entry["mean_difference"] == pytest.approx(0.05)
        assert entry["ci95"] == pytest.approx([0.05, 0.05])
        assert entry["p_corrected"] >= entry["p_value"]
        assert entry["second_mean"] - entry["first_mean"] == pytest.approx(0.05)
    json.dumps(report.to_json(), allow_nan=False)
    assert "second/run beside first/run" in as_text(report)
    shown = next(section for section in report.sections if section.title == "The same trials of both")
    assert all([result.title for result in picture.results] == ["first/run", "second/run"] for picture in shown.items)
    assert all("+0.050" in picture.caption for picture in shown.items)


def test_a_run_beside_itself_does_not_differ(write):
    run = write("first", 0.0)
    rows = build_report([run], beside=[run]).to_json()["beside"]["rows"]
    assert {entry["mean_difference"] for entry in rows} == {0.0}


def test_models_are_paired_by_their_number_and_worlds_may_differ(made):
    def rows(gain, world):
        made_rows = [row(made, trial=t, run=r, strict=0.5 + 0.01 * t + gain[r]) for t in range(4) for r in range(3)]
        return [
            replace(
                one,
                model=f"{world}{one.record.key.run}",
                record=replace(one.record, key=replace(one.record.key, world=world)),
            )
            for one in made_rows
        ]

    both = SideBySide(Side("a", rows((0.0, 0.1, 0.2), "bench")), Side("b", rows((0.1, 0.2, 0.3), "kinova")))
    assert both.runs_are_models
    overall = next(entry for entry in both.entries if entry["setup"] == "all")
    assert (overall["models"], overall["trials"]) == (3, 4)
    assert overall["mean_difference"] == pytest.approx(0.1)
    assert overall["ci95"] == pytest.approx([0.1, 0.1])
    assert overall["second_condition"]["world"] == "kinova"
    assert isinstance(both.first.rows[0], Row)


def test_runs_without_a_common_trial_are_refused(write):
    first, second = write("first", 0.0), write("second", 0.0, data_digest="e" * 64)
    with pytest.raises(InputError, match="no trial of the same data, goals and method in common"):
        build_report([first], beside=[second])
