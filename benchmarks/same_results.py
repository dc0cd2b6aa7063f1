"""One evaluation in many ways: the records must be identical but for times. Needs root for the way with two nodes.

    python benchmarks/same_results.py data --model model [--methods grammar halve] [--setups N1M1 N1M2] [--trials 1]
                                      [--world kinova] [--keep FOLDER]

The ways: in one process; with 1, 2 and 4 workers; with methods and setups in another order; killed in the middle
(driver and workers, by SIGKILL) and resumed; and on a second Ray node, in a network namespace of its own, with a token,
which got this program and a plugin through --py-module (the head has no CPUs). Exit code 1: something differs. The code
must not change meanwhile.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar.trials.setups import SETUPS
from measures.namespaces import PORT, nodes, start

PROGRAM = (sys.executable, "-m", "cutgrammar_pipelines")
PLUGIN = '''"""A method that is installed where the command is started only."""

from cutgrammar import Method, find_method

THIRD_PARTY = Method("third-party", lambda context: find_method("random").planner(context))
'''


def install_plugin(site: Path) -> Path:
    """Install `PLUGIN` into a folder for PYTHONPATH, and return its module."""
    facts = site / "third_party-1.0.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: third-party\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text("[cutgrammar.methods]\nthird-party = third_party:THIRD_PARTY\n")
    module = site / "third_party.py"
    module.write_text(PLUGIN)
    return module


def results(run: Path) -> tuple[dict[str, str], str]:
    """Trial -> digest of its record without times; and the report without timing, as JSON."""
    digests = {record.key.name: record.digest for record in read_records(ledger_of(run))}
    words = [*PROGRAM, "report", "--runs", str(run), "--json", "--no-timing"]
    return digests, subprocess.run(words, check=True, capture_output=True, text=True).stdout


def interrupted(command: list[str], environment: Mapping[str, str], run: Path) -> None:
    """Evaluate, kill driver and workers when some trials are done, and resume."""
    process = subprocess.Popen(command, env=dict(environment), start_new_session=True)
    while process.poll() is None and (not ledger_of(run).exists() or len(read_records(ledger_of(run))) < 3):
        time.sleep(0.05)
    if process.poll() is not None:
        raise RuntimeError("the evaluation ended before it could be killed; give more --trials")
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    print(f"killed when {len(read_records(ledger_of(run)))} trials were done", flush=True)
    subprocess.run(command, env=dict(environment), check=True)


def on_a_second_node(
    command: list[str], environment: Mapping[str, str], folder: Path, module: Path, network: int
) -> None:
    """Evaluate on a cluster of two nodes, of which only the one without the driver has CPUs."""
    with nodes(2, 1, folder, network) as cluster:
        cluster[0].cpus = 0
        start(cluster)
        cluster[0].environment = {**cluster[0].environment, "PYTHONPATH": environment["PYTHONPATH"]}
        joined = ["--address", f"{cluster[0].address}:{PORT}", "--workers", "1", "--py-module", str(module)]
        if code := cluster[0].run([*command, *joined]).wait():
            raise subprocess.CalledProcessError(code, command)


def main() -> int:
    """Read the command line, evaluate in all ways, and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--model", type=Path, required=True)
    parser.add_argument("--methods", nargs="+", default=["grammar", "halve", "random"])
    parser.add_argument("--setups", nargs="+", default=list(SETUPS))
    parser.add_argument("--network", type=int, default=8, help="number of the network; another for each cluster")
    parser.add_argument("--ways", nargs="+", help="words of the ways to compare, such as one second; all if not given")
    parser.add_argument("--trials", type=int, default=1, help="of each setup")
    parser.add_argument("--world", default="bench")
    parser.add_argument("--keep", type=Path, help="folder in which everything stays; a temporary one if not given")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        return compare(given, folder)


def compare(given: argparse.Namespace, folder: Path) -> int:
    """Evaluate in all ways; 1 if the results differ."""
    module = install_plugin(folder / "site")
    store = f"sqlite:///{folder.resolve() / 'mlflow.db'}"
    environment = {**os.environ, "PYTHONPATH": str(module.parent.resolve()), "MLFLOW_TRACKING_URI": store}
    methods, setups = [*given.methods, "third-party"], given.setups
    common = ["--data", str(given.data), "--model", str(given.model), "--world", given.world, "--runs", "1", "--quiet"]
    common += ["--trials", str(given.trials)]
    in_order = ["--methods", *methods, "--setups", *setups]
    shuffled = ["--methods", *reversed(methods), "--setups", *reversed(setups)]

    def plain(command: list[str], _: Path) -> None:
        subprocess.run(command, env=environment, check=True)

    def killed(command: list[str], run: Path) -> None:
        interrupted(command, environment, run)

    def second(command: list[str], _: Path) -> None:
        on_a_second_node(command, environment, folder, module, given.network)

    ways: dict[str, tuple[list[str], Callable[[list[str], Path], None]]] = {
        "in one process": ([*in_order, "--workers", "0"], plain),
        "1 worker": ([*in_order, "--workers", "1"], plain),
        "2 workers": ([*in_order, "--workers", "2"], plain),
        "4 workers": ([*in_order, "--workers", "4"], plain),
        "another order": ([*shuffled, "--workers", "2"], plain),
        "killed and resumed": ([*in_order, "--workers", "2"], killed),
        "on a second node": (in_order, second),
    }
    expected: tuple[dict[str, str], str] | None = None
    differing = 0
    for number, (name, (words, carry_out)) in enumerate(ways.items()):
        if given.ways and not set(given.ways) & set(name.split()):
            continue
        run = folder / f"run-{number}"
        began = time.monotonic()
        carry_out([*PROGRAM, "evaluate", *common, "--out", str(run), *words], run)
        found = results(run)
        expected = expected or found
        changed = sum(expected[0].get(key) != digest for key, digest in found[0].items())
        wrong = bool(changed or found[0].keys() != expected[0].keys() or found[1] != expected[1])
        differing += wrong
        report = "the same" if found[1] == expected[1] else "DIFFERS"
        seconds = time.monotonic() - began
        print(f"{name:<20} {len(found[0])} records, {changed} differ; report {report}; {seconds:.0f} s", flush=True)
    return int(differing > 0)


if __name__ == "__main__":
    sys.exit(main())
