import os
import signal
from functools import partial
from pathlib import Path

import pytest

from cutgrammar_workers import ray_pool
from cutgrammar_workers.planner_actor import PlannerCrew


def shifted(number, by):
    return number + by


def refuse(number):
    raise ValueError(f"{number} is no good")


def die_once(number, folder):
    died = Path(folder) / f"died-{number}"
    if number == 2 and not died.exists():
        died.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


@pytest.mark.slow
def test_searches_are_spread_over_actors_in_order_outliving_their_deaths(tmp_path):
    with ray_pool.session(2):
        spread = PlannerCrew(2)
        try:
            assert spread(partial(shifted, by=10), range(7)) == list(range(10, 17))
            assert spread(partial(die_once, folder=str(tmp_path)), range(5)) == list(range(5))
            with pytest.raises(RuntimeError, match=r"a planner actor failed: ValueError: . is no good"):
                spread(refuse, range(3))
            assert spread(partial(shifted, by=1), [5]) == [6]
            assert spread(partial(shifted, by=1), []) == []
        finally:
            spread.close()
