"""What tests of workers have in common: modules that Ray's workers can import, and a Ray that starts once."""

import os
from pathlib import Path

import pytest

from cutgrammar_workers.ray_session import session


@pytest.fixture(scope="module", autouse=True)
def importable_support():
    """Ray's workers, which start within a test, find the modules of `tests/support`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(__file__).parents[1] / "support"), prepend=os.pathsep)
        yield


@pytest.fixture(scope="module")
def two_cpus(importable_support):
    """A local Ray with two CPUs; `session` and `run_all` use it while it is there."""
    with session(2):
        yield
