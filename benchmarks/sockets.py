"""What every command that serves or computes listens at, and what a cluster answers to strangers. Needs root.

    python benchmarks/sockets.py RUN --data data --model model

RUN is a finished run, for `rate` and `report`. Prints the listening sockets of each command's processes while it runs.
Then a Ray head with a token is started in one network namespace, and `evaluate --address` is called from another: with
the right token, none, a wrong one, and with tokens turned off.
"""

import argparse
import contextlib
import os
import secrets
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import psutil

from measures.namespaces import PORT, Node, nodes, start

PROGRAM = (sys.executable, "-m", "cutgrammar_pipelines")
MAX_SECONDS = 240.0
"""Longest time until a command listens [s]."""
NETWORK = 9


def program_of(process: psutil.Process) -> str:
    """A short name of a process."""
    line = process.cmdline() or [process.name()]
    known = ("gcs_server", "raylet", "monitor.py", "dashboard.py", "log_monitor.py", "rerun", "uvicorn", "mlflow")
    found = next((name for name in known if any(name in word for word in line[:4])), None)
    return line[0] if line[0].startswith("ray::") else found or "cutgrammar"


def listening(processes: Sequence[psutil.Process]) -> dict[str, set[str]]:
    """Address -> programs that listen there."""
    found: dict[str, set[str]] = {}
    for process in processes:
        with contextlib.suppress(psutil.Error):
            for connection in process.net_connections("tcp"):
                if connection.status == psutil.CONN_LISTEN:
                    found.setdefault(connection.laddr.ip, set()).add(f"{program_of(process)}:{connection.laddr.port}")
    return found


def watched(words: Sequence[str], environment: Mapping[str, str], settle: float) -> dict[str, set[str]]:
    """The sockets of a command, of all times, until it ends or has not opened another for `settle` seconds."""
    quiet = subprocess.DEVNULL
    process = subprocess.Popen([*PROGRAM, *words], env=dict(environment), stdout=quiet, stderr=quiet)
    seen: dict[str, set[str]] = {}
    began = last = time.monotonic()
    everyone = {process.pid: psutil.Process(process.pid)}
    while process.poll() is None and time.monotonic() - began < MAX_SECONDS:
        with contextlib.suppress(psutil.Error):
            everyone |= {child.pid: child for child in psutil.Process(process.pid).children(recursive=True)}
        before = sum(map(len, seen.values()))
        for address, programs in listening(list(everyone.values())).items():
            seen.setdefault(address, set()).update(programs)
        if sum(map(len, seen.values())) > before:
            last = time.monotonic()
        if seen and time.monotonic() - last > settle:
            break
        time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    process.wait()
    for left in everyone.values():  # a viewer stays
        with contextlib.suppress(psutil.Error):
            left.kill()
    return seen


def answers(node: Node, words: Sequence[str], folder: Path) -> None:
    """Print what a head answers to a command in another namespace, by token."""
    right = node.environment["RAY_AUTH_TOKEN"]
    base = {name: value for name, value in node.environment.items() if not name.startswith("RAY_AUTH")}
    nowhere = {"HOME": tempfile.gettempdir(), "RAY_AUTH_TOKEN_PATH": "/nowhere"}
    for name, more in {
        "the right token": {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": right},
        "no token": {"RAY_AUTH_MODE": "token", **nowhere},
        "a wrong token": {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)},
        "tokens disabled": {"RAY_AUTH_MODE": "disabled"},
    }.items():
        node.environment = {**base, **more}
        began = time.monotonic()
        fresh = [*words, "--out", f"{folder}/{name}"]  # a finished run does not join
        process = node.run([*PROGRAM, *fresh], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        said = process.communicate()[1].decode().strip().splitlines()
        print(
            f"{name}: exit {process.returncode} after {time.monotonic() - began:.0f} s, {len(said)} line: {said[-1:]}"
        )


def main() -> None:
    """Read the command line and print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path)
    parser.add_argument("--data", required=True)
    parser.add_argument("--model", required=True)
    parser.add_argument("--settle", type=float, default=20.0, help="seconds without a new socket that end a command")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        out = Path(name)
        environment = {**os.environ, "MLFLOW_TRACKING_URI": f"sqlite:///{out / 'mlflow.db'}", "OMP_NUM_THREADS": "1"}
        evaluate = ["evaluate", "--data", given.data, "--model", given.model, "--methods", "halve", "--world", "bench"]
        commands = {
            "record": ["record", "--out", f"{out}/by-hand", "--port", "0"],
            "rate": ["rate", str(given.run), "--port", "0"],
            "evaluate --workers 0": [*evaluate, "--out", f"{out}/run-0", "--workers", "0", "--trials", "1"],
            "evaluate --workers 1": [*evaluate, "--out", f"{out}/run-1", "--workers", "1"],
            "evaluate --workers 0 --watch": [*evaluate, "--out", f"{out}/run-2", "--workers", "0", "--watch"],
            "collect --workers 1": ["collect", "--out", f"{out}/data", "--workers", "1"],
            "mlflow": ["mlflow", "--port", "5017", "--no-browser"],  # of the store that the others wrote to
            "report": ["report", str(given.run), "--out", f"{out}/report.html"],
        }
        for command, words in commands.items():
            seen = watched(words, environment, given.settle)
            print(f"{command}: {'nothing' if not seen else ''}", flush=True)
            for address, programs in sorted(seen.items()):
                print(f"    {address}: {', '.join(sorted(programs))}", flush=True)
        with nodes(2, 1, out, NETWORK) as cluster:
            start(cluster[:1])
            said = cluster[0].run(["ss", "-ltnpH"], stdout=subprocess.PIPE).communicate()[0].decode()
            for line in sorted(said.splitlines()):
                place, program = line.split()[3], line.partition('(("')[2].partition('"')[0]
                print(f"a head: {place} {program}", flush=True)
            joined = [*evaluate, "--address", f"{cluster[0].address}:{PORT}", "--quiet"]
            answers(cluster[1], joined, out)


if __name__ == "__main__":
    main()
