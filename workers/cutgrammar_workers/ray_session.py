"""Starting a local Ray, or joining a cluster, for the length of a `with` block."""

import contextlib
import importlib.util
import logging
import os
import signal
import socket
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

import ray

from cutgrammar.errors import InputError

PACKAGES = ("cutgrammar", "cutgrammar_sim", "cutgrammar_workers", "cutgrammar_pipelines", "cutgrammar_dashboards")
"""Packages that are sent to a cluster that is joined."""


@contextlib.contextmanager
def session(workers: int | None, address: str | None = None, py_modules: Sequence[Path] = ()) -> Iterator[None]:
    """Ray for the length of a `with` block; a Ray that this process has already started is used and left running.

    Args:
        workers: CPUs of a local Ray; None for all of this machine.
        address: of a running cluster; None starts a local one.
        py_modules: further packages or modules to send to the cluster.

    Raises:
        InputError: there is no cluster at `address`, or it runs another version of Ray or Python.
    """
    if ray.is_initialized():
        yield
        return
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    with _own_sigterm():
        _init(workers, address, py_modules)
    try:
        yield
    finally:
        ray.shutdown()


def _init(workers: int | None, address: str | None, py_modules: Sequence[Path]) -> None:
    quiet = {"logging_level": logging.ERROR, "log_to_driver": False}
    if address is None:
        ray.init(address="local", num_cpus=cores() if workers is None else workers, include_dashboard=False, **quiet)
    else:
        _check_address(address)
        try:
            ray.init(address=address, runtime_env={"py_modules": [*_package_folders(), *map(str, py_modules)]}, **quiet)
        except ConnectionError as error:
            raise _no_cluster(address, error) from error
        except RuntimeError as error:  # another version of Ray or Python
            raise InputError(f"the Ray cluster at {address!r} cannot be joined: {first_line(error)}") from error


@contextlib.contextmanager
def _own_sigterm() -> Iterator[None]:
    """Keep this process's handler of SIGTERM, which `ray.init` replaces with one that exits at once."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    except SystemExit:  # of Ray's handler
        ray.shutdown()
        if callable(before):
            before(signal.SIGTERM, None)
        raise
    finally:
        signal.signal(signal.SIGTERM, before)


def cores() -> int:
    """Number of CPUs of the Ray that this process has joined; without one, of those that this process may use."""
    if ray.is_initialized():
        return max(1, int(ray.cluster_resources().get("CPU", 0)))
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def is_listening(address: str) -> bool:
    """Whether a server listens at HOST:PORT."""
    try:
        _check_address(address)
    except InputError:
        return False
    return True


def first_line(error: BaseException) -> str:
    """The first line of an error's message, or its type where it has none."""
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__


def _check_address(address: str) -> None:
    """Raise within seconds if no server listens at HOST:PORT; Ray itself would try for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdigit():
        return  # "auto" and other names that Ray resolves itself
    try:
        socket.create_connection((host, int(port)), timeout=10).close()
    except OSError as error:
        raise _no_cluster(address, error) from error


def _no_cluster(address: str, error: Exception) -> InputError:
    return InputError(f"no Ray cluster answers at {address!r} ({first_line(error)}); start one or leave --address out")


def _package_folders() -> list[str]:
    """One folder for each of `PACKAGES`."""
    specs = [importlib.util.find_spec(name) for name in PACKAGES]
    return [str(folder) for spec in specs if spec is not None for folder in spec.submodule_search_locations or ()]
