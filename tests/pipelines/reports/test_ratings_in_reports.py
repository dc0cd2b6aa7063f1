"""What reports, JSON and MLflow show of people's ratings."""

import json
import re

import pytest

from cutgrammar.errors import InputError
from cutgrammar.results.comparisons import ALL
from cutgrammar.results.evaluation_report import evaluation_report
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.ratings import RatingStore, ratings_of
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar.trials.rating_plan import OTHER, SAME, Pair
from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.reports.text import as_text
from cutgrammar_pipelines.tracking.evaluation_logs import evaluation_logs
from made_ratings import answers, result
from report_rows import row


@pytest.fixture
def rated_run(made, tmp_path):
    facts = made.facts_of()
    records = made.records_of(facts, setups=["N1M1", "N2M1"])
    run = made.write_run(tmp_path / "run", facts, records, records)
    keys = [record.key for record in read_records(ledger_of(run))]
    checks = [(Pair(SAME, keys[0]), 5), (Pair(OTHER, keys[0], keys[-1]), 1)]
    store = RatingStore(ratings_of(run))
    for rater, shift in (("A", 0), ("B", 1)):
        values = [(result(key), (4 if key.method == "grammar" else 2) + shift) for key in keys]
        for one in answers(rater, [*checks, *values]):
            store.add(one)
    store.close()
    return run


def test_the_ratings_of_a_run_join_its_report(rated_run):
    report = build_report([rated_run])
    said = as_text(report)
    assert "Human rating in each setup" in said
    assert "Table I: Human Rating here and as the paper prints it" in said
    assert "4.32 ± 0.77" in said
    line = said.partition("Human rating in each setup")[2].partition("\ngrammar ")[2].splitlines()[1]
    low, high = map(float, re.findall(r"(\d\.\d\d) to (\d\.\d\d)", line)[0])
    assert low <= 4.5 <= high, "the interval stands below its mean"
    found = {(r["setup"], r["method"]): r for r in report.to_json()["rows"]}
    assert found["N1M1", "grammar"]["human_rating_mean"] == pytest.approx(4.5)
    assert found["N1M1", "grammar"]["human_rating_ratings"] == 8


def test_mlflow_gets_the_ratings_on_the_run_of_their_method(rated_run):
    logs = {log.name: log for log in evaluation_logs(rated_run, build_report([rated_run]))}
    metrics = logs["grammar"].metrics
    assert metrics["human_rating/N1M1"] == metrics["human_rating/mean"] == pytest.approx(4.5)
    assert metrics["human_rating_std/N1M1"] == pytest.approx(0.5345, abs=1e-3)
    assert metrics["human_rating_ci95_low/mean"] <= 4.5 <= metrics["human_rating_ci95_high/mean"]
    assert metrics["human_rating_raters/all"] == 2
    assert logs["largest"].metrics["human_rating/N1M1"] == pytest.approx(2.5)
    alphas = {log.metrics.get("human_rating_alpha/all") for log in logs.values() if log.tags["kind"] == "method"}
    assert len(alphas) == 1
    assert None not in alphas


def test_a_torn_file_of_ratings_stops_the_report(rated_run):
    ratings_of(rated_run).write_bytes(b"torn")
    with pytest.raises(InputError, match=r"ratings.sqlite is torn or foreign"):
        build_report([rated_run])


def test_a_report_shows_ratings_in_tables_and_json_and_says_who_does_not_count(made):
    rows = [row(made, method=method, trial=trial) for method in ("bc", "grammar") for trial in range(3)]
    keys = [one.record.key for one in rows]
    checks = [(Pair(SAME, keys[0]), 5), (Pair(OTHER, keys[0], keys[1]), 1)]
    ratings = []
    for rater, shift in (("A", 0), ("B", 1), ("R2D2", 1)):
        values = [(result(k), (1 if k.method == "bc" else 4) + shift) for k in keys]
        ratings += answers(rater, [*checks, *values], robot=rater == "R2D2")
    report = evaluation_report(rows, ratings=ratings)
    found = report.to_json()
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    by_method = {r["method"]: r for r in found["rows"] if r["setup"] == ALL}
    assert by_method["bc"]["human_rating_mean"] == pytest.approx(1.5)
    assert by_method["grammar"]["human_rating_mean"] == pytest.approx(4.5)
    assert {entry["human_rating_mean"] for entry in found["setup_means"]} == {1.5, 4.5}
    assert [one["reason"] for one in found["human_rating"]["raters"]] == ["", "", "a test robot"]
    assert "ratings of R2D2 do not count: a test robot" in report.notes
    section = next(section for section in report.sections if section.title == "Human rating")
    assert "2 of 3 raters count" in section.lead
    cells = [[cell.text for cell in r.cells] for r in section.items[0].rows]
    assert [r[0] for r in cells] == ["grammar", "bc"]
    assert cells[1][1] == "1.50 ± 0.55"


def test_only_robots_leave_no_number(made):
    rows = [row(made, trial=trial) for trial in range(2)]
    ratings = answers("R", [(result(one.record.key), 5) for one in rows], robot=True)
    report = evaluation_report(rows, ratings=ratings)
    assert all(r["human_rating_mean"] is None for r in report.to_json()["rows"])
    assert report.to_json()["human_rating"]["alpha"] is None
