"""What becomes of MLflow's store when its first users are killed, or are several at once.

RUN is a finished run. `sync` is killed with SIGKILL at moments that are spread over the creation of its database and
the first log; then it is run whole, and the store must show exactly what that of an undisturbed `sync` shows. At last
four copies of the run, and the same run four times, are synced at once into one new store.

For example: python benchmarks/mlflow_first_use.py run --moments 20
"""

import argparse
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

POLL_SECONDS = 0.005
USERS = 4
Shown = list[tuple[str, str, tuple[tuple[str, float], ...], tuple[tuple[str, str], ...]]]


def sync(run: Path, store: Path) -> subprocess.Popen[str]:
    """Start `cutgrammar sync RUN` with a database in the folder `store`."""
    return subprocess.Popen(
        [sys.executable, "-m", "cutgrammar_pipelines", "sync", str(run)],
        env={**os.environ, "MLFLOW_TRACKING_URI": f"sqlite:///{store / 'mlflow.db'}"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def shown(store: Path) -> Shown:
    """Every run of a store: name, status, latest metrics, parameters."""
    with closing(sqlite3.connect(store / "mlflow.db")) as database:
        runs = database.execute("SELECT run_uuid, name, status FROM runs").fetchall()
        metrics = database.execute("SELECT run_uuid, key, value FROM latest_metrics ORDER BY key").fetchall()
        params = database.execute("SELECT run_uuid, key, value FROM params ORDER BY key").fetchall()
    return sorted(
        (
            name,
            status,
            tuple(row[1:] for row in metrics if row[0] == key),
            tuple(row[1:] for row in params if row[0] == key),
        )
        for key, name, status in runs
    )


def creation(run: Path, store: Path) -> tuple[float, float, float]:
    """Seconds from the start of an undisturbed `sync` until its database is begun, is whole, and all is logged."""
    begun, moments = time.monotonic(), []
    process = sync(run, store)
    for file in ("mlflow.db.new", "mlflow.db"):
        while not (store / file).exists():
            if process.poll() is not None:
                raise RuntimeError(f"sync ended without {file}: {process.communicate()[0]}")
            time.sleep(POLL_SECONDS)
        moments.append(time.monotonic() - begun)
    said, _ = process.communicate()
    if process.returncode:
        raise RuntimeError(f"sync failed: {said}")
    return moments[0], moments[1], time.monotonic() - begun


def kill_at(run: Path, store: Path, moment: float) -> str:
    """Kill a `sync` that many seconds after it begins the database; says what it had left then."""
    process = sync(run, store)
    while process.poll() is None and not (store / "mlflow.db.new").exists():
        time.sleep(POLL_SECONDS)
    time.sleep(moment)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    if not (store / "mlflow.db").exists():
        return "before the database was whole"
    with closing(sqlite3.connect(store / "mlflow.db")) as database:
        return f"with {database.execute('SELECT count(*) FROM runs').fetchone()[0]} runs logged"


def main() -> None:
    """Measure, print, and exit with 1 if a store was not as it must be."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="a finished run")
    parser.add_argument("--moments", type=int, default=20, help="number of kills")
    options = parser.parse_args()
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        copies = [root / "study" / f"run-{number}" for number in range(USERS)]
        for copy in copies:
            shutil.copytree(options.run, copy)
        (root / "well").mkdir()
        start, whole, end = creation(copies[0], root / "well")
        expected = shown(root / "well")
        print(
            f"undisturbed: begun after {start:.1f} s, whole after {whole:.1f} s, {len(expected)} runs after {end:.1f} s"
        )
        for number in range(options.moments):  # three in four while the database is made, the others while it is filled
            during = (options.moments * 3 + 3) // 4
            share, length, first = (
                ((number + 0.5) / during, whole - start, 0.0)
                if number < during
                else ((number - during + 0.5) / (options.moments - during), end - whole, whole - start)
            )
            moment, store = first + share * length, root / f"killed-{number}"
            store.mkdir()
            left = kill_at(copies[0], store, moment)
            again = sync(copies[0], store)
            said, _ = again.communicate()
            is_good = again.returncode == 0 and shown(store) == expected and not (store / "mlflow.db.new").exists()
            bad += not is_good
            print(
                f"killed {moment:5.2f} s after its beginning, {left}: {'complete' if is_good else f'BAD {said}'}",
                flush=True,
            )
            shutil.rmtree(store)
        for runs, wanted in ((copies, USERS * len(expected)), (copies[:1] * USERS, len(expected))):
            store = root / f"at-once-{wanted}"
            store.mkdir()
            users = [sync(run, store) for run in runs]
            said = [user.communicate()[0] for user in users]
            codes, found = [user.returncode for user in users], shown(store)
            is_good = codes == [0] * USERS and len(found) == wanted and {run[1] for run in found} == {"FINISHED"}
            bad += not is_good
            kind = f"{len(set(runs))} runs" if len(set(runs)) > 1 else "one run"
            print(
                f"{USERS} first users of {kind} at once: exit codes {codes}, {len(found)} of {wanted} runs in the store"
            )
            if not is_good:
                print("".join(said))
    print("every store was complete" if not bad else f"{bad} stores were not as they must be")
    sys.exit(bool(bad))


if __name__ == "__main__":
    main()
