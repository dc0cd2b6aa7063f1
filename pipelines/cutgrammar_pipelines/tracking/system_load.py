"""The load of this machine during a long training, as MLflow's page of a run shows it under "System metrics"."""

import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import psutil

PERIOD = 10.0
"""Time between samples [s]; shorter trainings have none."""
History = dict[str, list[tuple[int, float]]]
"""Name of a metric -> (time [ms since 1970], value) pairs."""


@contextmanager
def watch_system(period: float = PERIOD) -> Iterator[Mapping[str, list[tuple[int, float]]]]:
    """Yield a history that grows by one sample each `period` seconds until the context ends.

    The names are those that MLflow gives its own measurements, so that its page of system metrics shows them.
    """
    history: History = {}
    ended = threading.Event()
    thread = threading.Thread(target=_sample, args=(history, period, ended), daemon=True)
    thread.start()
    try:
        yield history
    finally:
        ended.set()
        thread.join()


def _sample(history: History, period: float, ended: threading.Event) -> None:
    psutil.cpu_percent()  # of the time since the last call
    while not ended.wait(period):
        now, memory = time.time_ns() // 1_000_000, psutil.virtual_memory()
        values = {
            "cpu_utilization_percentage": psutil.cpu_percent(),
            "system_memory_usage_megabytes": memory.used / 1e6,
            "system_memory_usage_percentage": memory.percent,
        }
        for name, value in values.items():
            history.setdefault(f"system/{name}", []).append((now, float(value)))
