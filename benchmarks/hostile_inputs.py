"""What the commands do with hostile files: cases made by hand and, with --random, random ones.

    python benchmarks/hostile_inputs.py
    python benchmarks/hostile_inputs.py --random 20000 --seed 0

Each input is a copy of good files, one of which is spoiled, with digests made anew, and runs through the command in a
process of its own. A command fails if it takes over 10 s or 2 GB, prints a traceback, a control character or a long
line, writes outside its folder, ends with another exit code than 2 and one line of error, or, for cases made by hand,
does not name file and field. Random inputs may be harmless, so they may also pass. Prints failures and counts a reader.
"""

import argparse
import os
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from hostile.cases import WARM_UP, Case
from hostile.corpus import corpus
from hostile.good import make_good
from hostile.mutations import counts, mutated
from hostile.running import foreign_writes, problem_of, run, warm_up

ARM = Path(__file__).parents[1] / "tests" / "data" / "ur5e.urdf"


def check(case: Case, good: Path, place: Path) -> str | None:
    """Run a case in the empty folder `place`; what the command did wrong, or None."""
    return checked(case, good, place)[0]


def checked(case: Case, good: Path, place: Path) -> tuple[str | None, bool]:
    """The same, and whether the command accepted the input."""
    folder = place / "stranger"
    shutil.copytree(good, folder)
    (place / "out").mkdir()
    case.spoil(folder)
    result = run(case.words, folder)
    problem = problem_of(result, case.named, case.may_pass)
    if written := foreign_writes(place, ("stranger", "out", "elsewhere")):
        problem = f"writes {', '.join(written)}"
    elsewhere = place / "elsewhere"
    if elsewhere.exists() and sorted(entry.name for entry in elsewhere.iterdir()) not in ([], ["victim"]):
        problem = "writes elsewhere"
    if (elsewhere.exists() and "journal" in case.name) and not (elsewhere / "victim").exists():
        problem = "deletes a file elsewhere"
    return problem, result.code == 0


def main() -> int:
    """Run the cases, and print what fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--random", type=int, default=0, help="number of random inputs, instead of those made by hand")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--readers", nargs="*", default=[])
    parser.add_argument("--good", type=Path, help="folder of good files, to make them once")
    given = parser.parse_args()
    failed, passed, total = Counter[str](), Counter[str](), Counter[str]()
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as temporary:
        os.environ["MLFLOW_TRACKING_URI"] = f"sqlite:///{temporary}/mlflow.db"
        good = given.good or Path(temporary, "good")
        if not good.exists():
            good.mkdir(parents=True)
            make_good(good, ARM)
        warm_up(good, Path(temporary), dict.fromkeys(WARM_UP))
        for number, (reader, case) in enumerate(_cases(given.random, given.seed, given.readers)):
            place = Path(temporary, str(number))
            place.mkdir()
            problem, accepted = checked(case, good, place)
            shutil.rmtree(place)
            total[reader] += 1
            failed[reader] += problem is not None
            passed[reader] += accepted
            if problem:
                print(f"{reader}: {case.name}: {problem}", flush=True)
    for reader in total:
        print(f"{reader}: {total[reader]} inputs, {passed[reader]} accepted, {failed[reader]} failed")
    print(f"{total.total()} inputs, {failed.total()} failed, {time.monotonic() - began:.0f} s")
    return 1 if failed.total() else 0


def _cases(random: int, seed: int, readers: list[str]) -> Iterator[tuple[str, Case]]:
    if random:
        for reader, count in counts(random, readers).items():
            yield from ((reader, mutated(seed, number, reader)) for number in range(count))
    else:
        yield from ((case.reader, case) for case in corpus() if not readers or case.reader in readers)


if __name__ == "__main__":
    sys.exit(main())
