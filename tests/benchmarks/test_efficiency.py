import sys
import time

import pytest

import efficiency


def test_only_a_way_s_own_turns_count():
    turns = [(0.0, 4.0), (10.0, 14.0), (20.0, 24.0)]
    assert efficiency.active(turns, 3.0, 21.0) == pytest.approx(1.0 + 4.0 + 1.0)
    assert efficiency.active(turns, 5.0, 9.0) == 0.0


def test_trials_are_counted_from_when_the_first_ones_have_ended():
    turns = [(0.0, 10.0), (100.0, 110.0)]
    assert efficiency.steady_rate(turns, [[2.0, 4.0, 101.0, 108.0]], skip=2, workers=1) == pytest.approx(2 / 14)
    two = [[2.0, 4.0, 101.0, 108.0], [3.0, 5.0, 102.0, 106.0]]
    assert efficiency.steady_rate(turns, two, skip=2, workers=1) == pytest.approx(3 / 11), "while both work"
    one = [[2.0, 4.0, 101.0, 106.0, 109.0]]
    assert efficiency.steady_rate(turns, one, skip=2, workers=2) == pytest.approx(2 / 12), "while both have trials"


def test_a_way_works_in_its_turns_only(tmp_path):
    child = "import time\nfor i in range(40):\n  print(time.time(), flush=True)\n  time.sleep(.05)"
    parent = f"import subprocess, sys; sys.exit(subprocess.run([sys.executable, '-c', {child!r}]).returncode)"
    way = efficiency.Way([[sys.executable, "-c", parent]], tmp_path / "output", None, {})
    while way.work(0.5):
        time.sleep(0.5)
    way.check()
    (ends,) = way.ends()
    assert len(ends) == 40
    inside = sum(any(begin <= end <= last + 0.05 for begin, last in way.turns) for end in ends)
    assert inside == 40
    assert len(way.turns) > 2


def test_a_way_that_fails_ends_the_benchmark(tmp_path):
    way = efficiency.Way([[sys.executable, "-c", "raise ValueError('no such data')"]], tmp_path / "output", None, {})
    while way.work(0.5):
        pass
    with pytest.raises(SystemExit, match="no such data"):
        way.check()
