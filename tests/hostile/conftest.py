"""Good files of every reader, and a process in which hostile ones are read."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest

from hostile.good import make_good

ARM = Path(__file__).parents[1] / "data" / "ur5e.urdf"


@contextmanager
def logging_beside(folder):
    """Commands log to a store beside this folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{folder.parent / 'mlflow.db'}")
        yield


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """A folder with good files of every reader, which all modules share."""
    folder = tmp_path_factory.mktemp("good") / "files"
    folder.mkdir()
    with logging_beside(folder):
        make_good(folder, ARM)
    return folder


@pytest.fixture(scope="module")
def good(made):
    """A folder with good files of every reader; commands that log do so beside it."""
    with logging_beside(made):
        yield made


@pytest.fixture(scope="module")
def clean_process():
    """Calls a function in one process that has none of the threads and memory that tests have left in this one.

    Inputs are read in forks, and a fork of a process with threads may hang.
    """
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as process:
        yield lambda function, *given: process.submit(function, *given).result()
