"""One Ray for the tests of a module that neither start nor lose one."""

import os
from pathlib import Path

import pytest

from cutgrammar_workers.ray_session import session

SUPPORT = str(Path(__file__).parents[1] / "support")
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [SUPPORT, os.environ.get("PYTHONPATH")]))
"""So that Ray's workers find what tests have in common."""


@pytest.fixture(scope="module")
def two_cpus():
    """A local Ray with two CPUs; `session` and `run_all` use it while it is there."""
    with session(2):
        yield
