"""A footer that kills pyarrow kills no command, and an opening takes one process, however many parts there are."""

import shutil

import pytest

from cutgrammar.errors import InputError
from cutgrammar.settings import DemonstratorSettings
from cutgrammar.storage import part_footers
from cutgrammar.storage.data_set import DataSet, write_data_set
from hostile.good import sign_data
from hostile.table_cases import deadly


@pytest.fixture
def foreign(demonstrate, tmp_path):
    """A data set of three parts that this process did not write."""
    several = [demonstrate(trial, cuts=1, seed=7) for trial in (0, 50, 100)]
    write_data_set(tmp_path / "own", several, DemonstratorSettings(), 7)
    return shutil.copytree(tmp_path / "own", tmp_path / "data")


@pytest.fixture
def processes(monkeypatch):
    """The modules that are run as processes."""
    started, run = [], part_footers.run_parser
    monkeypatch.setattr(
        part_footers, "run_parser", lambda module, *given: started.append(module) or run(module, *given)
    )
    return started


@pytest.mark.parametrize(("table", "column"), [("fragments", b"parent"), ("trials", b"seed")])
def test_a_footer_that_kills_its_reader_is_refused_by_name(foreign, table, column):
    file = foreign / table / "part-00001.parquet"
    file.write_bytes(deadly(file.read_bytes(), column))
    sign_data(foreign)
    with pytest.raises(InputError, match=f"{table}/part-00001.parquet cannot be used"):
        DataSet.open(foreign)
    with pytest.raises(InputError, match=f"{table}/part-00001.parquet cannot be used"):
        DataSet.open(foreign)


def test_an_opening_takes_one_process_and_the_next_one_none(foreign, processes):
    data = DataSet.open(foreign)
    assert [data.demonstration(trial.trial).trial for trial in data.trials] == [0, 50, 100]
    DataSet.open(foreign)
    assert len(processes) == 1


def test_parts_of_this_program_take_no_process(foreign, processes, tmp_path):
    digest = DataSet.open(tmp_path / "own").digest
    DataSet.open(foreign, known=digest)
    assert not processes


def test_a_part_that_changes_is_read_by_a_process_again(foreign, processes):
    DataSet.open(foreign)
    file = foreign / "cuts" / "part-00000.parquet"
    file.write_bytes(deadly(file.read_bytes(), b"undone"))
    sign_data(foreign)
    with pytest.raises(InputError, match=r"cuts/part-00000.parquet cannot be used"):
        DataSet.open(foreign)
    assert len(processes) == 2


def test_a_reader_that_does_not_start_is_told(foreign, monkeypatch):
    monkeypatch.setattr("sys.executable", "/bin/false")
    with pytest.raises(InputError, match=r"part-00000.parquet cannot be used \(its footer cannot be read: no process"):
        DataSet.open(foreign)
