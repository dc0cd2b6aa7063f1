"""`cutgrammar mlflow`: MLflow's server on the store, and the chart page of a study in a browser."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
import webbrowser
from pathlib import Path

from cutgrammar.errors import InputError, listed
from cutgrammar_pipelines.config import MlflowConfig
from cutgrammar_pipelines.tracking.chart_page import SCORES, TRAININGS, link
from cutgrammar_pipelines.tracking.mlflow_store import (
    ENVIRONMENT,
    STUDY,
    Store,
    failures,
    open_store,
    store_folder,
    store_name,
    store_uri,
)

START = 180.0
"""Longest time that the server may take to answer [s]; a busy machine needs half a minute."""


def serve(config: MlflowConfig) -> int:
    """Start MLflow's page on the store, on this machine only, until it is stopped; return its exit code.

    Raises:
        InputError: there is no store yet, it cannot be read or has no such study, or the port is taken.
    """
    uri, port = store_uri(), config.port
    remote = uri.startswith(("http://", "https://"))
    if uri.startswith("sqlite:///") and not Path(uri.removeprefix("sqlite:///")).exists():
        raise InputError(f"there is no store {store_name()} yet; train or evaluate creates one in the current folder")
    if not remote:
        _check(port)
    pages = _pages(config.study)
    if remote:
        print(f"MLflow's page is at {store_name()}{pages}")
        return 0
    address = f"http://127.0.0.1:{port}"
    print(f"MLflow's page for {store_name()} will be at {address}{pages} in half a minute; Ctrl-C stops it", flush=True)
    command = ["server", "--backend-store-uri", uri, "--default-artifact-root", str(store_folder(uri) / "mlartifacts")]
    command += ["--host", "127.0.0.1", "--port", str(port), "--workers", "1", "--app-name", "cutgrammar"]
    environment = ENVIRONMENT | dict(os.environ)
    # In a session of its own, so that Ctrl-C reaches only this process, which then ends the server quietly.
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, _leave)
    server = subprocess.Popen([sys.executable, "-m", "mlflow", *command], env=environment, start_new_session=True)
    if not config.no_browser and _has_desktop():
        threading.Thread(target=_open, args=(address, pages, server), daemon=True).start()
    try:
        return server.wait()
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(server.pid, signal.SIGTERM)
        server.wait()


def _check(port: int) -> None:
    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a port that was closed just now is free
        try:
            trial.bind(("127.0.0.1", port))
        except (OSError, OverflowError):
            raise InputError(f"port {port} cannot be used on this machine; try --port {port % 60000 + 1}") from None


def _pages(study: str | None) -> str:
    """The part of the address that shows the study's chart page; without a study, that of the latest."""
    try:
        return _page_of(open_store(), study)
    except failures() as error:
        reason = (str(error) or type(error).__name__).splitlines()[0][:200]
        raise InputError(
            f"the store {store_name()} cannot be read ({reason}); name another in MLFLOW_TRACKING_URI"
        ) from None


def _page_of(store: Store, study: str | None) -> str:
    """The chart page of the study, or of that with the latest run."""
    studies = {one.name: one.experiment_id for one in store.client.search_experiments() if STUDY in one.tags}
    if study is not None and study not in studies:
        names = listed(sorted(studies)) or "none"
        raise InputError(f"the store {store_name()} has no study {study!r}; those that it has: {names}")
    asked = list(studies.values()) if study is None else [studies[study]]
    latest = store.client.search_runs(asked, order_by=["attributes.start_time DESC"], max_results=1) if asked else []
    if not latest:
        return "/"
    found = latest[0].info.experiment_id
    methods = store.client.search_runs([found], filter_string="tags.kind = 'method'", max_results=1)
    return link(found, SCORES if methods else TRAININGS)


def _open(address: str, page: str, server: "subprocess.Popen[bytes]") -> None:
    """Open the page in a browser as soon as the server answers."""
    end = time.monotonic() + START
    while time.monotonic() < end and server.poll() is None:
        try:
            with urllib.request.urlopen(f"{address}/health", timeout=5):
                webbrowser.open(f"{address}{page}")
                return
        except OSError:
            time.sleep(0.5)


def _has_desktop() -> bool:
    """Whether a browser would have a window; elsewhere one in the terminal might start."""
    return sys.platform in ("darwin", "win32") or any(name in os.environ for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def _leave(number: int, _: object) -> None:
    """End this process so that its server is stopped, too."""
    sys.exit(128 + number)
