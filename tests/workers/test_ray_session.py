"""The Ray that a run starts for itself."""

import os

import psutil
import pytest

from cutgrammar_workers.pool import run_all


class Sockets:
    """Tells where the processes of this run listen."""

    def __init__(self, driver):
        self.driver = driver

    def __call__(self, _):
        driver = psutil.Process(self.driver)
        found = {}
        for process in (driver, *driver.children(recursive=True), psutil.Process()):
            listening = [one for one in process.net_connections("tcp") if one.status == psutil.CONN_LISTEN]
            found[process.pid, process.name()] = {one.laddr.ip for one in listening}
        return found


@pytest.mark.slow
def test_a_local_run_listens_on_loopback_only():
    found = []
    run_all(Sockets, os.getpid(), [None], lambda _, result: found.append(result), 1)
    assert set().union(*found[0].values()) <= {"127.0.0.1", "::ffff:127.0.0.1", "::1"}, found
