"""Hostile clients of the pages that real commands serve, while two people work there.

The attacks are those of `benchmarks/hostile_clients.py`, which makes all of them on both pages. Both have the same
server, so here one page has all, and the other those that reach its own handlers and those with few open files.
"""

import shutil

import pytest

from hostile.clients import ATTACKS, broken_off, many, messages
from hostile_clients import problems_of

pytestmark = pytest.mark.slow
FILES = 120
"""Files that a command may have open where they are few."""


def more_than_files(port, rng):
    """More slow connections than the command may have files open."""
    many(port, rng, FILES + 10)


@pytest.mark.parametrize(
    ("page", "attacks", "files"),
    [
        ("record", ATTACKS, None),
        ("rate", (messages, broken_off), None),
        ("rate", (more_than_files,), FILES),
    ],
)
def test_people_work_on_and_nothing_is_lost_or_printed(page, attacks, files, good, tmp_path):
    words = {
        "record": ["record", "--out", "data", "--trials", "3000", "--setups", "N1M1", "--foods", "block"],
        "rate": ["rate", str(shutil.copytree(good / "run", tmp_path / "run")), "--pairs", "3000"],
    }[page]
    (tmp_path / "place").mkdir()
    wrong = problems_of(words, tmp_path / "place", attacks, seed=2026, files=files)
    assert not wrong, "\n".join(wrong)
