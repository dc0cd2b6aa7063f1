import os
import signal
from functools import partial
from pathlib import Path

import pytest

from cutgrammar_workers.planner_pool import PlannerPool
from cutgrammar_workers.ray_session import session


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
def test_searches_run_on_actors_in_order_even_if_actors_die(tmp_path):
    with session(2):
        pool = PlannerPool(2)
        try:
            assert pool(partial(shifted, by=10), range(7)) == list(range(10, 17))
            assert pool(partial(die_once, folder=str(tmp_path)), range(5)) == list(range(5))
            with pytest.raises(RuntimeError, match=r"a planner actor failed: ValueError: . is no good"):
                pool(refuse, range(3))
            assert pool(partial(shifted, by=1), [5]) == [6]
            assert pool(partial(shifted, by=1), []) == []
        finally:
            pool.close()
