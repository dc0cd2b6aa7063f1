"""What the commands do with hostile files: the corpus of cases made by hand, or random ones."""

import argparse
import os
import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path

from hostile.cases import Case
from hostile.corpus import corpus
from hostile.good import make_good
from hostile.running import foreign_writes, problem_of, run

ARM = Path(__file__).parents[1] / "tests" / "data" / "ur5e.urdf"


def check(case: Case, good: Path, place: Path) -> str | None:
    """Run a case in the empty folder `place`; what the command did wrong, or None."""
    folder = place / "stranger"
    shutil.copytree(good, folder)
    (place / "out").mkdir()
    case.spoil(folder)
    result = run(case.words, folder)
    problem = problem_of(result, case.named, case.may_pass)
    if written := foreign_writes(place, ("stranger", "out", "elsewhere")):
        problem = f"writes {', '.join(written)}"
    if (place / "elsewhere").exists() and sorted(p.name for p in (place / "elsewhere").iterdir()) not in ([], ["victim"]):
        problem = "writes elsewhere"
    return problem


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--readers", nargs="*")
    parser.add_argument("--good", type=Path)
    parser.add_argument("--grep", default="")
    parser.add_argument("-v", action="store_true")
    given = parser.parse_args()
    os.environ["MLFLOW_TRACKING_URI"] = ""
    failed, total = Counter(), Counter()
    with tempfile.TemporaryDirectory() as temporary:
        good = given.good or Path(temporary, "good")
        if not given.good:
            good.mkdir()
            make_good(good, ARM)
        for number, case in enumerate(corpus()):
            if (given.readers and case.reader not in given.readers) or given.grep not in case.name:
                continue
            place = Path(temporary, str(number))
            place.mkdir()
            problem = check(case, good, place)
            shutil.rmtree(place)
            total[case.reader] += 1
            failed[case.reader] += problem is not None
            if problem:
                print(f"{case.reader}: {case.name}: {problem}", flush=True)
            elif given.v:
                print(f"{case.reader}: {case.name}: fine", flush=True)
    for reader in total:
        print(f"{reader}: {failed[reader]} of {total[reader]} failed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
