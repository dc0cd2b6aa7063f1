"""Hostile clients of the pages that real commands serve, while two people work there.

The attacks are those of `benchmarks/hostile_clients.py`; here also with few files that the command may open.
"""

import shutil

import pytest

from hostile.clients import ATTACKS, many
from hostile_clients import problems_of

pytestmark = pytest.mark.slow


@pytest.fixture(params=["record", "rate"])
def words(request, good, tmp_path):
    """A command that serves a page."""
    if request.param == "record":
        return ["record", "--out", "data", "--trials", "3000", "--setups", "N1M1", "--foods", "block"]
    return ["rate", str(shutil.copytree(good / "run", tmp_path / "run")), "--pairs", "3000"]


@pytest.mark.parametrize(("attacks", "files"), [(ATTACKS, None), ((many,), 120)])
def test_people_work_on_and_nothing_is_lost_or_printed(attacks, files, words, tmp_path):
    (tmp_path / "place").mkdir()
    wrong = problems_of(words, tmp_path / "place", attacks, seed=2026, files=files)
    assert not wrong, "\n".join(wrong)
