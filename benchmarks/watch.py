"""What --watch costs and that it changes nothing: with a viewer, without one, and with one that is killed or stopped.

    python benchmarks/watch.py data --model model [--trials 2] [--repetitions 3] [--workers 2] [--methods grammar halve]

Evaluates the same trials on the bench under five conditions, one after the other and again: `without` --watch; `with` a
headless viewer on this machine, which gives way to everything else; `absent`: nothing listens at the port; `killed`:
the viewer gets SIGKILL after a third of the usual time; `stopped`: it gets SIGSTOP then. Prints the time of every
evaluation, and the ratio of each condition's median to that of `without`. The records must be the same bit by bit,
except for times. Ends with exit code 1 if they are not, or a ratio is over 1.1.
"""

import argparse
import contextlib
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar_dashboards.recording.viewer import free_port, quiet_environment, viewer_binary
from cutgrammar_pipelines.config import EvaluateConfig
from cutgrammar_pipelines.stages.evaluate import evaluate

CONDITIONS = ("without", "with", "absent", "killed", "stopped")
SIGNALS = {"killed": signal.SIGKILL, "stopped": signal.SIGSTOP}
MAX_RATIO = 1.1


@contextlib.contextmanager
def viewer(condition: str, port: int, after: float) -> Iterator[None]:
    """The viewer of a condition, which gets its signal `after` seconds."""
    if condition in ("without", "absent"):
        yield
        return
    words = ["nice", "-n", "19", str(viewer_binary()), "--headless", "--bind", "127.0.0.1", "--port", str(port)]
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(words, env=quiet_environment(), stdout=quiet, stderr=quiet)
    time.sleep(5.0)
    timer = threading.Timer(after, process.send_signal, [SIGNALS[condition]]) if condition in SIGNALS else None
    if timer is not None:
        timer.start()
    try:
        yield
    finally:
        if timer is not None:
            timer.cancel()
        process.kill()
        process.wait()


def digests(run: Path) -> dict[str, str]:
    """Trial -> digest of its record, without times."""
    return {record.key.name: record.digest for record in read_records(ledger_of(run))}


def main() -> int:
    """Run all conditions and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--model", type=Path, required=True)
    parser.add_argument("--trials", type=int, default=2)
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--methods", nargs="+", default=["grammar", "halve"])
    options = parser.parse_args()
    times: dict[str, list[float]] = {condition: [] for condition in CONDITIONS}
    expected: dict[str, str] | None = None
    same = True
    with tempfile.TemporaryDirectory() as folder:
        for repetition in range(-1, options.repetitions):  # the first only compiles and fills caches
            for condition in CONDITIONS if repetition >= 0 else ("without",):
                port, out = free_port(), Path(folder) / f"{condition}{repetition}"
                usual = times["without"][-1] if times["without"] else 0.0
                config = EvaluateConfig(
                    data=options.data,
                    model=options.model,
                    out=out,
                    methods=tuple(options.methods),
                    trials=options.trials,
                    runs=1,
                    world="bench",
                    workers=options.workers,
                    watch=None if condition == "without" else (str(port),),
                )
                with viewer(condition, port, usual / 3.0):
                    began = time.perf_counter()
                    evaluate(config)
                    seconds = time.perf_counter() - began
                found = digests(out)
                expected = expected or found
                same = same and found == expected
                if repetition >= 0:
                    times[condition].append(seconds)
                    verdict = "same records" if found == expected else "OTHER RECORDS"
                    print(f"{condition:8} {seconds:7.2f} s  {len(found)} trials, {verdict}", flush=True)
    medians = {condition: statistics.median(values) for condition, values in times.items()}
    ratios = {condition: medians[condition] / medians["without"] for condition in CONDITIONS}
    print("ratios of medians: " + ", ".join(f"{name} {ratio:.3f}" for name, ratio in ratios.items()))
    return int(not same or max(ratios.values()) > MAX_RATIO)


if __name__ == "__main__":
    sys.exit(main())
