"""What the commands do with hostile files: cases made by hand and, with --random, random ones.

    python benchmarks/hostile_inputs.py
    python benchmarks/hostile_inputs.py --random 20000 --seed 0
    python benchmarks/hostile_inputs.py --random 20000 --seed 0 --read

Each input is a copy of good files, one of which is spoiled, with digests made anew, and runs through the command in a
process of its own. A command fails if it computes for over 10 s, takes over 2 GB, prints a traceback, a control
character or a long line, writes outside its folder, ends with another exit code than 2 and one line of error, or, for
cases made by hand, does not name file and field. Random inputs may be harmless, so they may also pass. With --read the
files are only read, without the work of the commands, and pages are asked, which is faster. Prints failures and counts
a reader.
"""

import argparse
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from hostile.cases import WARM_UP, Case
from hostile.corpus import corpus
from hostile.good import make_good, trust_good_parts
from hostile.mutations import COMMANDS, counts, mutated
from hostile.reading import BATCH, read_all
from hostile.running import Result, foreign_writes, problem_of, run, warm_up

ARM = Path(__file__).parents[1] / "tests" / "data" / "ur5e.urdf"


def check(case: Case, good: Path, place: Path) -> str | None:
    """Run a case in the empty folder `place`; what the command did wrong, or None."""
    return checked(case, good, place)[0]


def checked(case: Case, good: Path, place: Path) -> tuple[str | None, Result]:
    """The same, and what the command did."""
    folder = place / "stranger"
    shutil.copytree(good, folder)
    (place / "out").mkdir()
    case.spoil(folder)
    trust_good_parts(folder, good)
    result = run(case.words, folder)
    problem = problem_of(result, case.named, case.may_pass)
    if written := foreign_writes(place, ("stranger", "out", "elsewhere")):
        problem = f"writes {', '.join(written)}"
    elsewhere = place / "elsewhere"
    if elsewhere.exists() and sorted(entry.name for entry in elsewhere.iterdir()) not in ([], ["victim"]):
        problem = "writes elsewhere"
    if (elsewhere.exists() and "journal" in case.name) and not (elsewhere / "victim").exists():
        problem = "deletes a file elsewhere"
    return problem, result


def problems_of(reader: str, good: Path, place: Path) -> list[str]:
    """Run the cases of a reader that are made by hand in the empty folder `place`; what is wrong, a line each.

    Raises:
        ValueError: there are no cases of this reader.
    """
    cases = [case for case in corpus() if case.reader == reader]
    if not cases:
        raise ValueError(f"no cases of the reader {reader}")
    wrong = []
    for number, case in enumerate(cases):
        own = place / str(number)
        own.mkdir()
        if problem := check(case, good, own):
            wrong.append(f"{case.name}: {problem}")
        shutil.rmtree(own)
    return wrong


@dataclass
class Count:
    """What became of the inputs of one reader; times are those of the command [s]."""

    inputs: int = 0
    accepted: int = 0
    failed: int = 0
    seconds: float = 0.0
    slowest: float = 0.0

    def add(self, problem: str | None, result: Result) -> None:
        """Count one input."""
        self.inputs += 1
        self.accepted += result.code == 0
        self.failed += problem is not None
        self.seconds += result.seconds
        self.slowest = max(self.slowest, result.seconds)


def main() -> int:
    """Run the cases, and print what fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--random", type=int, default=0, help="number of random inputs, instead of those made by hand")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--readers", nargs="*", default=[])
    parser.add_argument("--good", type=Path, help="folder of good files, to make them once")
    parser.add_argument("--read", action="store_true", help="only read the inputs, without the work of the commands")
    parser.add_argument("--share", default="0/1", help="only inputs whose number is I modulo N, as I/N")
    given = parser.parse_args()
    share, shares = map(int, given.share.split("/"))
    counted: dict[str, Count] = {}
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as temporary:
        os.environ["MLFLOW_TRACKING_URI"] = f"sqlite:///{temporary}/mlflow.db"
        good = given.good or Path(temporary, "good")
        if not good.exists():
            good.mkdir(parents=True)
            make_good(good, ARM)
        if given.read:
            return _read(given, good, Path(temporary, "place"))
        readers = given.readers or ([*COMMANDS, "mesh"] if given.random else [])
        random = [command for reader in readers for command in COMMANDS.get(reader, ())] if given.random else []
        warm_up(good, Path(temporary), dict.fromkeys((*WARM_UP, *random)))
        for number, (reader, case) in enumerate(_cases(given.random, given.seed, readers)):
            if number % shares != share:
                continue
            place = Path(temporary, str(number))
            place.mkdir()
            problem, result = checked(case, good, place)
            shutil.rmtree(place)
            counted.setdefault(reader, Count()).add(problem, result)
            if problem:
                print(f"{reader}: {case.name}: {problem}", flush=True)
            if (done := sum(count.inputs for count in counted.values())) % 500 == 0:
                failed = sum(count.failed for count in counted.values())
                print(f"{done} inputs, {failed} failed, {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
    print(table_of(counted))
    return 1 if any(count.failed for count in counted.values()) else 0


def _read(given: argparse.Namespace, good: Path, place: Path) -> int:
    """Read random inputs without the work of the commands."""
    counted: dict[str, Count] = {}
    share, shares = map(int, given.share.split("/"))
    every = [case for reader, case in _cases(given.random, given.seed, given.readers) if reader != "mesh"]
    cases = every[share::shares]
    for begin in range(0, len(cases), BATCH):
        batch = cases[begin : begin + BATCH]
        for case, (problem, accepted, seconds) in zip(batch, read_all(batch, good, place), strict=True):
            counted.setdefault(case.reader, Count()).add(problem, Result(0 if accepted else 2, "", "", seconds, 0))
            if problem:
                print(f"{case.reader}: {case.name}: {problem}", flush=True)
        if begin // BATCH % 10 == 9:
            print(f"{begin + len(batch)} inputs", file=sys.stderr, flush=True)
    print(table_of(counted))
    return 1 if any(count.failed for count in counted.values()) else 0


def table_of(counted: dict[str, Count]) -> str:
    """The counts as a Markdown table."""
    names = ("reader", "inputs", "refused", "accepted", "failed", "mean [s]", "slowest [s]")
    rows: list[tuple[object, ...]] = [names, ("---",) * len(names)]
    total = Count()
    for count in counted.values():
        for name, value in vars(count).items():
            setattr(total, name, max(total.slowest, value) if name == "slowest" else getattr(total, name) + value)
    for name, count in (*counted.items(), ("all", total)):
        refused = count.inputs - count.accepted - count.failed
        mean = count.seconds / max(1, count.inputs)
        rows.append((name, count.inputs, refused, count.accepted, count.failed, f"{mean:.2f}", f"{count.slowest:.1f}"))
    return "\n".join(f"| {' | '.join(map(str, row))} |" for row in rows)


def _cases(random: int, seed: int, readers: list[str]) -> Iterator[tuple[str, Case]]:
    """Random cases of all readers in turns, or those made by hand."""
    if random:
        order = sorted(
            (n / count, reader, n) for reader, count in counts(random, readers).items() for n in range(count)
        )
        yield from ((reader, mutated(seed, number, reader)) for _, reader, number in order)
    else:
        yield from ((case.reader, case) for case in corpus() if not readers or case.reader in readers)


if __name__ == "__main__":
    sys.exit(main())
