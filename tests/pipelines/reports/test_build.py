"""The report: its fields, its text, its page, and its notes about missing and differing rows."""

import csv
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.results.evaluation_report import evaluation_report
from cutgrammar.results.paper_table import COLUMNS, printed_rows
from cutgrammar.results.report import Table
from cutgrammar.results.score_table import Row, table_of
from cutgrammar.results.shown_trials import choose_trials
from cutgrammar.storage.configurations import TrialConfigurations
from cutgrammar.storage.ledger import Ledger, read_records
from cutgrammar.storage.run_folder import ledger_of, recording_of, settle_run
from cutgrammar.trials.setups import SETUPS
from cutgrammar_pipelines.config import ReportConfig, ShowConfig, ViewConfig
from cutgrammar_pipelines.inspection.show import show
from cutgrammar_pipelines.inspection.view import view
from cutgrammar_pipelines.reports.build import build_report, read_rows, report, write_report_page
from cutgrammar_pipelines.reports.text import as_text
from cutgrammar_pipelines.reports.trial_details import detail_sections, find_recordings
from report_rows import only, row

SCHEMA_1_RUN = Path(__file__).parents[2] / "data" / "schema_1_run"
ROW_FIELDS = [
    "setup",
    "goals",
    "world",
    "perception",
    "method",
    "trials",
    "iou_mean",
    "iou_strict_mean",
    "iou_refined_mean",
    "spectral_mean",
    "agreement_mean",
    "human_rating_mean",
    "iou_std_runs",
    "iou_strict_std_runs",
    "iou_strict_ci95",
    "cuts_mean",
    "failures",
    "stuck",
    "dead_ends",
    "seconds_mean",
    "digest",
]
LISTS = ["rows", "tests", "setup_means", "improvement", "profiles", "paper", "shown"]


def json_of(*runs, timing=True):
    return build_report(runs, timing).to_json()


def text_of(rows):
    return as_text(evaluation_report(list(rows)))


def test_the_object_has_the_fields_of_the_design(scored_run):
    built = json_of(scored_run)
    assert list(built) == ["schema", *LISTS, "digest"]
    assert built["schema"] == 1
    assert all(set(r) >= set(ROW_FIELDS) for r in built["rows"])
    assert set(built["tests"][0]) >= {
        "setup", "goals", "method", "against", "mean_difference", "ci95", "p_value", "p_corrected"
    }  # fmt: skip
    assert json.loads(json.dumps(built, allow_nan=False)) == built


def test_there_is_a_row_for_every_setup_and_all_of_them(scored_run, made):
    built = json_of(scored_run)
    assert [r["setup"] for r in built["rows"][::4]] == [*made.setups, "all"]
    assert [r["method"] for r in built["rows"][:4]] == ["grammar", "largest", "random", "replay"]
    assert {r["trials"] for r in built["rows"]} == {2, 6}


def test_scores_not_computed_are_null(scored_run):
    for r in json_of(scored_run)["rows"]:
        for name in ("iou_refined_mean", "spectral_mean", "agreement_mean", "human_rating_mean"):
            assert r[name] is None


def test_without_timing_nothing_that_was_timed_remains(scored_run):
    timed, untimed = json_of(scored_run), json_of(scored_run, timing=False)
    assert all("seconds" not in name for r in untimed["rows"] for name in r)
    assert [{k: v for k, v in r.items() if k != "seconds_mean"} for r in timed["rows"]] == untimed["rows"]


def test_p_values_are_corrected_within_their_family(scored_run):
    tests = json_of(scored_run)["tests"]
    overall = sorted((t["p_value"], t["p_corrected"]) for t in tests if t["setup"] == "all")
    assert overall[0][1] == pytest.approx(3 * overall[0][0])
    assert all(t["p_corrected"] >= t["p_value"] for t in tests)


def test_a_method_that_some_goals_do_not_admit_has_no_cell_there(made):
    rows = [row(made, trial=t, goals=g) for t in range(2) for g in ("in-place", "scattered")]
    rows += [row(made, method="copy", trial=t, strict=0.9) for t in range(2)]
    built = table_of(rows)
    for name in ("rows", "tests", "setup_means", "profiles"):
        assert {r["goals"] for r in built[name] if r["method"] == "copy"} == {"in-place"}
    assert {r["goals"] for r in built["improvement"]} == {"in-place"}
    said = text_of(rows)
    assert "copy" not in said[said.index("Goals scattered") :]


def test_the_digest_tells_results_apart_and_nothing_else(made, scored_run):
    facts = made.facts_of()
    records = made.records_of(facts)
    built = table_of(Row(record, "d" * 64) for record in records)
    slower = table_of(Row(replace(record, seconds=99.0), "d" * 64) for record in reversed(records))
    assert built["digest"] == slower["digest"] == json_of(scored_run, timing=False)["digest"]
    other = table_of(Row(record, "d" * 64) for record in [replace(records[0], cuts=6), *records[1:]])
    assert other["digest"] != built["digest"]
    changed = [
        (new["setup"], new["method"])
        for new, old in zip(other["rows"], built["rows"], strict=True)
        if new["digest"] != old["digest"]
    ]
    assert changed == [("N1M1", "grammar"), ("all", "grammar")]
    assert built["digest"][:16] in text_of(Row(record, "d" * 64) for record in records)


def test_the_paper_prints_four_methods_in_six_setups():
    printed = printed_rows()
    assert {one["setup"] for one in printed} == set(SETUPS)
    means = {m: np.mean([one["iou_mean"] for one in printed if one["method"] == m]) for m in COLUMNS}
    assert means == pytest.approx({"bc": 0.39, "qnet": 0.3083, "grammar": 0.5317, "human": 0.5883}, abs=1e-3)


def test_the_papers_numbers_are_shown_for_goals_in_place_only(made):
    said = text_of([row(made, goals=g, strict=0.25) for g in ("in-place", "scattered")])
    assert "0.250   0.250 0.58 ± 0.08" in said
    assert said.count("Table I: best-matched IoU here and as the paper prints it") == 1
    assert "they do not compare one to one" in said


def test_the_report_says_what_a_foreign_goal_is(made):
    said = " ".join(text_of([row(made, goals=g) for g in ("in-place", "foreign", "foreign-food")]).split())
    assert said.count("was cut into, scaled to the volume at hand") == 2
    assert "what an individual of another food was cut into" in said


def test_a_run_with_missing_rows_is_said_to_be_incomplete(made, tmp_path, capsys):
    facts = made.facts_of()
    records = made.records_of(facts, setups=["N1M1"])
    run = made.write_run(tmp_path / "half", facts, records, records[:-5])
    built = json_of(run)
    assert built["notes"] == ["half is incomplete: 5 of 16 rows are missing; the same evaluate command resumes it"]
    assert report(ReportConfig([run])) == 1
    assert "NOTE half is incomplete" in " ".join(capsys.readouterr().out.split())
    made.write_run(run, facts, [], records)
    assert "notes" not in json_of(run)


def test_a_run_named_twice_counts_once(scored_run):
    assert json_of(scored_run, scored_run) == json_of(scored_run)


def test_runs_that_differ_in_more_than_their_seed_are_said_to(made, scored_run, tmp_path):
    other = made.facts_of(seed=101)
    again = made.write_run(tmp_path / "again", other, [], made.records_of(other, runs=1))
    both = json_of(scored_run, again)
    assert "notes" not in both
    assert {r["trials"] for r in both["rows"]} == {2, 6}
    third = made.facts_of(seed=102, model_digests=("x" * 64,))
    retrained = made.write_run(tmp_path / "retrained", third, [], made.records_of(third, setups=["N1M1"], runs=1))
    assert json_of(scored_run, retrained)["notes"] == [
        "the runs run, retrained differ in model; the tables contain the rows of all of them"
    ]


def test_a_key_with_two_results_is_reported(made, scored_run, tmp_path):
    facts = made.facts_of()
    records = made.records_of(facts)
    other = made.write_run(tmp_path / "other", facts, [], [replace(records[0], scores={"iou_strict": 0.0}), records[1]])
    (note,) = json_of(scored_run, other)["notes"]
    assert note == f"{records[0].key.name} came out differently in other than in a run named before it"


def test_what_is_not_a_run_is_refused_in_one_line(tmp_path):
    with pytest.raises(InputError, match="is not a run: it has no run.json; cutgrammar evaluate creates one"):
        build_report([tmp_path])
    with pytest.raises(InputError, match="no run was named"):
        build_report([])


@pytest.mark.parametrize("width", [40, 60, 80, 100, 200])
def test_the_table_fits_the_terminal(scored_run, width):
    text = as_text(build_report([scored_run]), width)
    widest = max(len(line) for line in text.splitlines())
    assert widest <= max(width, 70)
    if width >= 80:
        assert widest <= width


def test_the_text_says_what_the_numbers_are(scored_run):
    built = json_of(scored_run)
    text = as_text(build_report([scored_run]))
    found = only(built, setup="N2M1", method="grammar")
    assert f"{found['iou_strict_mean']:.3f} ± {found['iou_strict_std_runs']:.3f}" in text
    assert "±: Standard deviation of the mean over the runs" in " ".join(text.split())


def test_a_single_run_has_no_spread_in_the_text(made):
    text = text_of([row(made, strict=0.25), row(made, trial=1, strict=0.75)])
    assert "0.500" in text
    assert "0.500 ±" not in text


def test_an_empty_run_says_so(made, tmp_path):
    facts = made.facts_of()
    run = made.write_run(tmp_path / "new", facts, made.records_of(facts)[:5], [])
    text = as_text(build_report([run]))
    assert text.startswith("No trial has been evaluated yet.")
    assert "5 of 5 rows are missing" in text
    write_report_page(build_report([run]), tmp_path / "new.html")


def test_json_is_one_object_and_nothing_else(scored_run, capsys):
    assert report(ReportConfig([scored_run], json=True, no_timing=True)) == 0
    assert json.loads(capsys.readouterr().out) == json_of(scored_run, timing=False)


def test_the_page_lists_the_worst_trials_with_what_shows_them(made, scored_run, tmp_path):
    page = tmp_path / "deep" / "report.html"
    records = [record for record in made.records_of(made.facts_of()) if record.key.method == "grammar"]
    worst = min(records, key=lambda record: (record.iou_strict, record.key))
    write_report_page(build_report([scored_run]), page)
    text = page.read_text()
    assert f"cutgrammar view {scored_run} {worst.key.name}" in text
    assert "d" * 64 in text
    assert sorted(p.name for p in page.parent.iterdir()) == ["report.html"]


def test_failed_trials_are_listed_after_the_worst_of_grammar(made, tmp_path):
    facts = made.facts_of()
    records = made.records_of(facts, setups=["N1M1"], trials=8, runs=2)
    failed = [replace(r, status="crashed", reason="it <b>died</b>") for r in records if r.key.method == "random"][3:5]
    records = [next((f for f in failed if f.key == r.key), r) for r in records]
    run = made.write_run(tmp_path / "run", facts, [], records)
    sections = {section.title: section for section in detail_sections([run], read_rows([run]).rows)}
    listed = [[cell.text for cell in row.cells] for row in sections["The worst trials"].items[0].rows]
    assert [cells[3] for cells in listed] == ["done"] * 12 + ["crashed: it <b>died</b>"] * 2
    assert all("-grammar-" in cells[0] for cells in listed[:12])
    assert {cells[0] for cells in listed[12:]} == {record.key.name for record in failed}


def test_the_worst_median_and_best_of_each_method_are_shown_without_a_recording(made, tmp_path, lump, random_pose):
    facts = made.facts_of()
    scored = made.scored_event([[0, 1, 0.5]])
    records = [replace(one, events=(scored,)) for one in made.records_of(facts, trials=2, runs=1)]
    one, two = Fragment(lump, random_pose()), Fragment(lump, random_pose())
    run = tmp_path / "run"
    settle_run(run, facts)
    with Ledger(ledger_of(run)) as ledger:
        for record in records:
            ledger.add(record, TrialConfigurations((one,), (one, two), (two,)))
    named = next(record.key.name for record in records if record.key.method == "replay")
    report = build_report([run], trials=[named])
    (section,) = [section for section in report.sections if section.title == "What was reached"]
    assert [picture.fold.partition(",")[0] for picture in section.items][:4] == ["Named trials", *["grammar"] * 3]
    of_grammar = sorted((r for r in records if r.key.method == "grammar"), key=lambda r: (r.iou_strict, r.key))
    assert [picture.caption for picture in section.items[1:4]] == [
        f"{of_grammar[place].key.name}: {why}" for place, why in ((0, "worst"), (2, "median"), (-1, "best"))
    ]
    result = section.items[1].results[0]
    assert result.pairs == ((0, 1, 0.5),)
    assert result.command == f"cutgrammar view {run} {of_grammar[0].key.name}"
    with pytest.raises(InputError, match="the closest name is"):
        build_report([run], trials=["N9"])


def test_a_page_with_too_many_trials_leaves_out_medians_first(made):
    scored = made.scored_event([[0, 0, 0.5]])
    records = [
        replace(one, events=(scored,))
        for one in made.records_of(made.facts_of(), methods=["grammar", "random", "replay"])
    ]
    chosen, left_out = choose_trials(records, limit=7)
    assert left_out == 2
    assert [why for why, _ in chosen] == ["worst", "median", "best", "worst", "best", "worst", "best"]
    assert choose_trials([replace(one, events=()) for one in records]) == ([], 0)


def test_a_recording_belongs_to_the_run_whose_trial_it_shows(made, tmp_path):
    facts = [made.facts_of(seed=seed) for seed in (1, 2)]
    records = [made.records_of(fact, setups=["N1M1"], methods=["grammar"], runs=1) for fact in facts]
    runs = [made.write_run(tmp_path / f"run{i}", facts[i], [], records[i]) for i in (0, 1)]
    name = records[1][0].key.name
    assert name == records[0][0].key.name
    recording_of(runs[1], name).parent.mkdir()
    recording_of(runs[1], name).touch()
    rows = [Row(record, "d" * 64) for record in (*records[0], *records[1])]
    found = find_recordings({fact.origin: [run] for fact, run in zip(facts, runs, strict=True)}, rows)
    assert found == {records[1][0].key: recording_of(runs[1], name)}


def test_a_run_of_schema_1_is_read_and_not_resumed(tmp_path):
    run = shutil.copytree(SCHEMA_1_RUN, tmp_path / "run")
    built = json_of(run)
    found = only(built, setup="all", method="replay")
    assert (found["trials"], found["iou_strict_mean"]) == (4, pytest.approx(1.0))
    assert all(found[f"{name}_mean"] is not None for name in ("iou", "iou_refined", "spectral", "agreement"))
    write_report_page(build_report([run]), tmp_path / "report.html")
    assert view(ViewConfig(run)) == 0
    assert show(ShowConfig(run)) == 0
    with pytest.raises(InputError, match="has schema 1, not 3: it can be read, but not resumed"):
        Ledger(ledger_of(run))


def test_the_text_of_a_report_is_the_golden_one(scored_run, check_golden):
    check_golden("report.txt", as_text(build_report([scored_run])))


def test_a_csv_has_a_line_for_every_trial_with_all_its_scores(scored_run, tmp_path, capsys):
    out = tmp_path / "deep" / "trials.csv"
    assert report(ReportConfig([scored_run], out=out)) == 0
    printed = capsys.readouterr().out
    with out.open(newline="") as file:
        lines = list(csv.DictReader(file))
    records = sorted(read_records(ledger_of(scored_run)), key=lambda record: record.key)
    assert [line["method"] for line in lines] == [record.key.method for record in records]
    assert [float(line["iou_strict"]) for line in lines] == [record.iou_strict for record in records]
    assert {line["model"] for line in lines} == {"m" * 64}
    assert {line["human_rating"] for line in lines} == {""}, "what is not known is empty"
    assert "Over all setups" in printed
    assert str(out) in printed
    report(ReportConfig([scored_run], out=out, no_timing=True))
    assert "seconds" not in out.read_text()


def test_latex_has_the_tables_of_the_text_and_escapes_them(scored_run, tmp_path):
    out = tmp_path / "tables.tex"
    assert report(ReportConfig([scored_run], out=out)) == 0
    text = out.read_text()
    built = build_report([scored_run])
    tables = [item for section in built.sections if not section.is_detail for item in section.items]
    titles = [table.title for table in tables if isinstance(table, Table) and not table.fold]
    assert text.count("\\begin{tabular}") == text.count("\\bottomrule") == len(titles) > 1
    bodies = re.findall(r"\\begin\{tabular\}\{([lr]+)\}(.*?)\\end\{tabular\}", text, re.DOTALL)
    for columns, body in bodies:
        for line in body.strip().splitlines():
            spanned = sum(int(n) - 1 for n in re.findall(r"\\multicolumn\{(\d+)\}", line))
            assert "rule" in line or len(re.findall(r"(?<!\\)&", line)) + spanned + 1 == len(columns)
    assert "replay \\dag{}" in text
    assert not re.search(r"(?<!\\)[%#_]", "".join(line for line in text.splitlines() if not line.startswith("%")))
    assert "95 \\% interval" in text
    assert "$-$0." in text
    assert not set("±†–↓<") & set(re.sub(r"\$[^$]*\$", "", text))


@pytest.mark.parametrize("name", ["report", "report.pdf", "trials.CSV"])
def test_a_report_that_is_no_page_csv_or_latex_is_refused(scored_run, tmp_path, name):
    with pytest.raises(ValueError, match=r"ends in \.html, \.csv, \.tex "):
        ReportConfig([scored_run], out=tmp_path / name)


def test_a_csv_of_two_runs_side_by_side_is_refused(scored_run, tmp_path):
    with pytest.raises(ValueError, match="name all runs"):
        ReportConfig([scored_run], beside=[scored_run], out=tmp_path / "trials.csv")
