"""What each release wrote is read, made anew, or refused with one line that says what to do.

`tests/data/releases` has a sample of each, made by that release: `collect --trials 4 --setups N1M1 --foods block`, then
`train` with the settings file beside it, and `evaluate --methods random replay --trials 1 --runs 1 --world bench`.
"""

import re
import shutil
from pathlib import Path

import pytest

from cutgrammar.errors import InputError
from cutgrammar.learning.model import load_model
from cutgrammar.settings import load_settings
from cutgrammar.storage import ledger_file, manifest, ratings, run_folder, split
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.ledger import Ledger, read_records
from cutgrammar.storage.run_folder import ledger_of, read_run
from cutgrammar.storage.split import read_split
from cutgrammar.trials import trajectory
from cutgrammar_pipelines.config import StudyConfig
from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.stages import plan_files
from cutgrammar_pipelines.study.study_file import load_study

ROOT = Path(__file__).parents[2]
RELEASES = ROOT / "tests" / "data" / "releases"
NAMES = sorted(folder.name for folder in RELEASES.iterdir())

every_release = pytest.mark.parametrize("release", NAMES)


def test_every_release_of_the_changelog_has_a_sample():
    assert sorted(re.findall(r"^## (\d\S*)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)) == NAMES


@every_release
def test_a_data_set_of_a_release_is_read(release):
    data = DataSet.open(RELEASES / release / "data")
    made = read_split(data)
    assert (len(data.trials), len(made.train), len(made.test)) == (4, 2, 2)
    one = data.demonstration(made.test[0])
    assert len(one.cuts) >= 2
    assert len(one.goal) >= 3


@every_release
def test_a_model_of_a_release_is_refused_with_what_to_do(release):
    schema = {"0.1.0": 2, "0.2.0": 3}[release]
    with pytest.raises(InputError, match=rf"has schema {schema}; this version reads schema \d+: train again$"):
        load_model(RELEASES / release / "model")


@every_release
def test_a_run_of_a_release_is_read_and_reported(release):
    run = RELEASES / release / "run"
    assert read_run(run).package == release
    assert {record.key.method: record.status for record in read_records(ledger_of(run))} == {
        "random": "done",
        "replay": "done",
    }
    rows = {row["method"]: row for row in build_report([run]).numbers["rows"] if row["setup"] == "all"}
    assert rows["replay"]["iou_strict_mean"] == pytest.approx(1.0)
    assert 0.0 < rows["random"]["iou_strict_mean"] < 1.0


@every_release
def test_a_ledger_of_a_release_is_migrated_or_says_that_it_can_be_read(release, tmp_path):
    path = ledger_of(shutil.copytree(RELEASES / release / "run", tmp_path / "run"))
    before = read_records(path)
    if release == "0.1.0":
        with pytest.raises(InputError, match="it can be read, but not resumed; evaluate into a new folder$"):
            Ledger(path)
    else:
        with Ledger(path) as ledger:
            assert [count for _, count in ledger.attempts().versions] == [2]
    assert read_records(path) == before


@pytest.mark.parametrize(
    ("release", "words"),
    [
        ("0.1.0", "unknown setting features.points; .* did you mean n_points"),
        ("0.2.0", "classifier.max_epochs; .* epochs"),
    ],
)
def test_settings_of_a_release_that_have_other_names_now_are_refused_with_the_name(release, words):
    with pytest.raises(InputError, match=words):
        load_settings(RELEASES / release / "settings.toml")


def test_a_study_file_of_0_1_0_says_where_its_options_belong(tmp_path):
    words = (
        r"study.trials is of version 0.1.0; write trials in the table \[collect\] or trials in the table \[evaluate\]"
    )
    with pytest.raises(InputError, match=words):
        load_study(StudyConfig(settings=RELEASES / "0.1.0" / "study.toml", out=tmp_path))


def test_a_study_file_of_0_2_0_is_read(tmp_path):
    study = load_study(StudyConfig(settings=RELEASES / "0.2.0" / "study.toml", out=tmp_path))
    assert (study.collect.trials, study.evaluate.world) == (110, "kinova")


def test_the_page_on_versions_has_todays():
    from cutgrammar.learning import model

    today = {
        "data set": manifest.SCHEMA,
        "split": split.SCHEMA,
        "model": model.SCHEMA,
        "run": run_folder.SCHEMA,
        "ledger": ledger_file.SCHEMA,
        "ratings": ratings.SCHEMA,
        "trajectories": trajectory.SCHEMA,
        "plan": plan_files.SCHEMA,
    }
    rows = re.findall(r"^\| ([^|]+) \|[^|]*\| (\d+) \|", (ROOT / "docs" / "versions.md").read_text(), re.MULTILINE)
    assert {name: int(number) for name, number in rows if name in today} == today
