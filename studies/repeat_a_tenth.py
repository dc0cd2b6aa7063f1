"""Carry out a share of a run's trials again, with another number of workers, and compare the records.

Chosen are the trials for which the first 15 hex digits of their key's digest are divisible by `--one-in`. Everything in
a record is compared except its times. An interrupted repetition resumes.

Run: python studies/repeat_a_tenth.py RUN --out AGAIN --workers 1 [--one-in 10]
"""

import argparse
import hashlib
import sys
from itertools import groupby
from pathlib import Path

from cutgrammar.errors import InputError
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of, read_run
from cutgrammar_pipelines.stages.evaluate.reproduce import reproduce_trials


def compare(run: Path, out: Path, workers: int, one_in: int) -> bool:
    """Repeat the chosen trials, print how they compare, and return whether all are identical."""
    records = read_records(ledger_of(run))
    drawn = [record for record in records if int(record.key.digest[:15], 16) % one_in == 0]
    before, different, of_all = {record.key: record.digest for record in drawn}, [], hashlib.sha256()
    for world, group in groupby(
        sorted(drawn, key=lambda record: record.key.world), key=lambda record: record.key.world
    ):
        reproduce_trials(run, sorted(record.key for record in group), out / world, workers)
        for record in read_records(ledger_of(out / world)):
            of_all.update(record.digest.encode())
            if record.digest != before.pop(record.key):
                different.append(record.key.name)
    print(
        f"{len(drawn)} of {len(records)} trials carried out again with {workers} workers: "
        f"{len(drawn) - len(different) - len(before)} records identical except for times, {len(different)} different, "
        f"{len(before)} missing; digest of the repeated records {of_all.hexdigest()}"
    )
    commits = {read_run(folder).commit for folder in (run, *(out / world for world in {r.key.world for r in drawn}))}
    if len(commits) > 1:
        print(f"NOTE the code is not the same: commits {', '.join(sorted(map(str, commits)))}")
    for name in different:
        print(f"different: {name}")
    return not different and not before


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="a folder that evaluate or study made")
    parser.add_argument(
        "--out", type=Path, required=True, help="folder of the repetition; it gets one run folder for each world"
    )
    parser.add_argument(
        "--workers", type=int, required=True, help="another number than the run was made with; 0: no Ray"
    )
    parser.add_argument("--one-in", type=int, default=10, help="repeat about one in this many trials (default 10)")
    chosen = parser.parse_args()
    try:
        sys.exit(not compare(chosen.run, chosen.out, chosen.workers, chosen.one_in))
    except InputError as error:
        sys.exit(str(error))
