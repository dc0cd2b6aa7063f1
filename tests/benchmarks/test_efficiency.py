import pytest

import efficiency


def test_what_happens_once_does_not_count_in_the_steady_state():
    steady, whole = efficiency.rates("2 workers", (10.0, 20.0), (5, 45))
    assert (steady, whole) == (pytest.approx(40 / 10 / 2), pytest.approx(45 / 20 / 2))
    assert efficiency.rates("two loops at once", (10.0, 20.0), (5, 45))[0] == pytest.approx(40 / 10)


def test_every_way_is_measured_at_both_lengths_in_turn():
    asked = []

    def seconds(what, trials):
        asked.append((what, trials))
        return {1: 3.0, 6: 13.0}[trials] * (1 + (what == "1 worker"))

    found = efficiency.measured(seconds, (1, 6), (4, 24), repetitions=2)
    ways = list(efficiency.CORES)
    assert asked == [(what, trials) for what in [*ways, *reversed(ways)] for trials in (1, 6)]
    assert efficiency.ratios(found, "1 worker", 0) == [pytest.approx(0.5)] * 2
