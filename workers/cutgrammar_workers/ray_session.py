"""Starting a local Ray, or joining a cluster, for the length of a `with` block."""

import contextlib
import importlib.util
import logging
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import ray
from ray._private import ray_constants
from ray._private import worker as ray_worker
from ray.exceptions import RayError

from cutgrammar.errors import InputError
from cutgrammar_workers.joining import check_address, first_line, host_and_port, no_cluster
from cutgrammar_workers.lifeline import Lifeline, lifeline

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
        InputError: there is no cluster at `address`, it cannot be joined, or it runs another version of Ray or Python.
        ConnectionError: the head of the cluster or this machine's node of it has died.
    """
    if ray.is_initialized():
        yield
        return
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    os.environ.setdefault("RAY_worker_niceness", "0")  # Ray's 15 leaves nothing that could give way to workers
    os.environ.setdefault("RAY_prestart_worker_first_driver", "0")  # for these, Ray has waited for ever
    with lifeline() as line:
        if address is not None and address != "auto":
            line.add({"head": host_and_port(address)})
        with _own_sigterm():
            _init(workers, address, py_modules, line)
        try:
            line.add(_parts())
            yield
        finally:
            if address is None and line.lost is None:
                line.end()  # the parts of a local Ray end with it
            ray.shutdown()
            _renew_sigterm()


def _init(workers: int | None, address: str | None, py_modules: Sequence[Path], line: Lifeline) -> None:
    quiet = {"logging_level": logging.ERROR, "log_to_driver": False}
    ray_worker.print_to_stdstream = _say_nothing
    if address is None:
        cpus = cores() if workers is None else workers
        try:
            with _on_loopback(), line.start():
                ray.init(address="local", num_cpus=cpus, include_dashboard=False, **quiet)
        except OSError:
            raise
        except Exception as error:  # Ray raises plain exceptions where one of its processes dies
            ray.shutdown()
            reason = f"Ray could not be started ({first_line(error)}); see whether --workers 0 works"
            raise ConnectionError(reason) from error
        return
    check_address(address)
    try:
        with line.start():
            ray.init(address=address, runtime_env={"py_modules": [*_package_folders(), *map(str, py_modules)]}, **quiet)
    except ConnectionError as error:
        raise no_cluster(address, first_line(error)) from error
    except (RayError, RuntimeError, ValueError) as error:  # another version, or packages that cannot be sent
        raise InputError(f"the Ray cluster at {address!r} cannot be joined: {first_line(error)}") from error


def _parts() -> dict[str, tuple[str, int]]:
    """Where the head and the node of this machine listen."""
    here = ray.get_runtime_context().get_node_id()
    own = next(node for node in ray.nodes() if node["NodeID"] == here)
    return {
        "head": host_and_port(ray.get_runtime_context().gcs_address),
        "own node": (own["NodeManagerAddress"], own["NodeManagerPort"]),
    }


def _say_nothing(*_: Any, **__: Any) -> None:
    """Instead of Ray, which prints a page of its log when a node dies; what dies is handled and told here."""


@contextlib.contextmanager
def _on_loopback() -> Iterator[None]:
    """Let a local Ray listen on this machine only, as Ray does where it supports no clusters."""
    before = ray_constants.ENABLE_RAY_CLUSTER
    ray_constants.ENABLE_RAY_CLUSTER = False
    try:
        yield
    finally:
        ray_constants.ENABLE_RAY_CLUSTER = before


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


def _renew_sigterm() -> None:
    """Set this process's handler of SIGTERM again, which Ray's C++ code has taken away without Python's knowledge."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.getsignal(signal.SIGTERM))


def cores() -> int:
    """Number of CPUs of the Ray that this process has joined; without one, of those that this process may use."""
    if ray.is_initialized():
        return max(1, int(ray.cluster_resources().get("CPU", 0)))
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _package_folders() -> list[str]:
    """One folder for each of `PACKAGES`."""
    specs = [importlib.util.find_spec(name) for name in PACKAGES]
    return [str(folder) for spec in specs if spec is not None for folder in spec.submodule_search_locations or ()]
