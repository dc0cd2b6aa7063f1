"""Opens recordings in rerun's viewer and merges them, with its binary bound to this machine and without telemetry."""

import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from cutgrammar.atomic_files import write_atomic
from cutgrammar.errors import InputError

NICENESS = 10
"""By how much a viewer that shows a run gives way to it."""


def viewer_binary() -> Path:
    """The viewer's binary; the `rerun` on the path is a wrapper that leaves it running when stopped.

    Raises:
        InputError: rerun is not installed with its viewer.
    """
    spec = find_spec("rerun_cli")
    if spec is not None and spec.origin is not None:
        binary = Path(spec.origin).parent / ("rerun.exe" if sys.platform == "win32" else "rerun")
        if binary.exists():
            return binary
    raise InputError("the rerun viewer is not installed; `pip install rerun-sdk` brings it")


def quiet_environment() -> dict[str, str]:
    """The environment for the viewer, which sends no usage data in continuous integration."""
    return {**os.environ, "CI": "true"}


def has_screen() -> bool:
    """Whether a window can be opened on this machine."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def open_recordings(paths: Sequence[Path]) -> int:
    """Show recordings in a window and wait until it is closed; returns the viewer's exit code."""
    command = [str(viewer_binary()), "--bind", "127.0.0.1", "--port", "auto", *map(str, paths)]
    return subprocess.run(command, env=quiet_environment(), check=False).returncode


def start_viewer() -> tuple[str, str]:
    """Start a viewer that waits for a run, and stays when this process ends; does not wait until it is there.

    Without a screen, it is a page for a browser on this machine.

    Returns:
        its URL for the run, and what to tell the user.

    Raises:
        InputError: rerun is not installed with its viewer.
    """
    port = free_port()
    words = [str(viewer_binary()), "--bind", "127.0.0.1", "--port", str(port), "--memory-limit", "2GB"]
    if nice := shutil.which("nice"):
        words = [nice, "-n", str(NICENESS), *words]
    told = f"a viewer shows the run; another time, --watch {port} shows it in the same one"
    if not has_screen():
        page = free_port()
        words += ["--serve-web", "--web-viewer-port", str(page), "--server-memory-limit", "1GB"]
        told = f"there is no screen here; in a browser on this machine, the run is at http://127.0.0.1:{page}"
        told += f"?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{port}%2Fproxy"
    quiet = subprocess.DEVNULL
    subprocess.Popen(
        words, env=quiet_environment(), stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True, close_fds=True
    )
    return f"rerun+http://127.0.0.1:{port}/proxy", told


def free_port() -> int:
    """A port of this machine that nothing listens at now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def merge(paths: Sequence[Path], out: Path) -> None:
    """Write one file with all recordings of `paths`, whole or not at all.

    Raises:
        InputError: rerun could not read one of them.
    """
    command = [str(viewer_binary()), "rrd", "merge", *map(str, paths)]
    done = subprocess.run(command, capture_output=True, env=quiet_environment(), check=False)
    if done.returncode != 0:
        errors = done.stderr.decode(errors="replace").strip().splitlines() or ["no reason given"]
        raise InputError(f"the recordings cannot be merged: {errors[-1]}; record the trials again with `--record all`")
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(out, done.stdout)
