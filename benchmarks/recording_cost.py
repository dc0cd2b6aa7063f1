"""What recordings cost: wall time with and without them, and megabytes a trial.

    python benchmarks/recording_cost.py run [--trials 6] [--repetitions 2] [--method grammar]

Carries out trials of a run again, those with the most fragments of each setup first, each with and without a recording
in turn, in this process. Prints for each trial its cuts, the size of its recording and both times, then the ratio of
all times and the mean size. Ends with exit code 1 if the ratio is over 1.1 or the mean over 1 MB.
"""

import argparse
import sys
import time
from pathlib import Path

from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar.trials.record import UNFINISHED, Record
from cutgrammar_pipelines.stages.evaluate.reproduce import worker_for

MAX_RATIO, MAX_MEGABYTES = 1.1, 1.0


def chosen(records: list[Record], method: str | None, count: int) -> list[Record]:
    """`count` records of a method, setup by setup in turn, those with the most fragments of each setup first."""
    known = [record for record in records if record.status not in UNFINISHED and method in (None, record.key.method)]
    by_setup: dict[str, list[Record]] = {}
    for record in sorted(known, key=lambda record: (-record.goal_fragments, record.key)):
        by_setup.setdefault(record.key.setup, []).append(record)
    ranked = [(rank, setup, record) for setup, of in by_setup.items() for rank, record in enumerate(of)]
    return [record for *_, record in sorted(ranked, key=lambda row: row[:2])][:count]


def main() -> int:
    """Carry out the trials and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder that evaluate made")
    parser.add_argument("--trials", type=int, default=6)
    parser.add_argument("--repetitions", type=int, default=2)
    parser.add_argument("--method", help="of all methods if not given")
    options = parser.parse_args()
    records = chosen(list(read_records(ledger_of(options.run))), options.method, options.trials)
    worker, jobs = worker_for(options.run, [record.key for record in records])
    worker(jobs[0])  # compiles and imports
    with_s, without_s, sizes = 0.0, 0.0, []
    print("trial                                                    cuts     MB  with s  without s")
    for index, record in enumerate(records):
        times = {True: 0.0, False: 0.0}
        for repetition in range(2 * options.repetitions):
            recorded = (repetition + index) % 2 == 0
            began = time.perf_counter()
            if recorded:
                recording = worker(jobs[index]).recording
            else:
                worker.carry_out(jobs[index])
            times[recorded] += time.perf_counter() - began
        assert recording is not None
        sizes.append(len(recording) / 1e6)
        with_s, without_s = with_s + times[True], without_s + times[False]
        cuts = sum(event["event"] == "CutMade" for event in record.events)
        print(f"{record.key.name:55} {cuts:5} {sizes[-1]:6.2f} {times[True]:7.2f} {times[False]:10.2f}", flush=True)
    ratio, mean = with_s / without_s, sum(sizes) / len(sizes)
    print(f"wall time with recordings / without: {ratio:.3f} (at most {MAX_RATIO})")
    print(f"megabytes a trial: mean {mean:.2f} (at most {MAX_MEGABYTES}), largest {max(sizes):.2f}")
    return int(ratio > MAX_RATIO or mean > MAX_MEGABYTES)


if __name__ == "__main__":
    sys.exit(main())
