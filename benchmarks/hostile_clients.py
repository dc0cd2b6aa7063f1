"""What hostile clients do to the pages that people work on, as real commands serve them.

    python benchmarks/hostile_clients.py RUN
    python benchmarks/hostile_clients.py RUN --seed 1 --attacks garbage many

Starts `cutgrammar record` and `cutgrammar rate RUN` on loopback. Two people work on each page as invited, while hostile
clients send, one kind after another: what is no HTTP, changed messages, giant headers, bodies and lengths, web socket
frames, foreign Host and Origin headers, addresses that lead out of the page, connections that are broken off, clients
that read nothing, and many slow connections. A page fails if a person gets an error or no answer, if the command ends
or prints a traceback, a control character or many lines, if anything foreign is answered, or if what it said it keeps
is not in the data set or the ratings, or is not taken up by the same command. RUN is a folder that `evaluate` made,
whose ratings grow: take a copy. Prints a line for each attack.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from random import Random

from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.ratings import read_ratings
from hostile.clients import ATTACKS, Attack, expect_answers
from hostile.served import Person, Served

CODES = ("guest-1", "guest-2")


def problems_of(
    words: Sequence[str], folder: Path, attacks: Sequence[Attack] = ATTACKS, seed: int = 0, files: int | None = None
) -> list[str]:
    """Attack the page that a command serves; what was wrong, a line each.

    Args:
        words: the command: record with `--out data`, or rate with the run as its first word.
        folder: an empty one to start it in.
        attacks: one after another.
        seed: of what they send.
        files: maximum number of files that the command may have open.
    """
    served, wrong, page = Served(words, folder, files), [], words[0]
    try:
        people = [Person(page, served.port, code) for code in CODES]
        for person in people:
            person.start()
        for attack in attacks:
            began, problem = time.monotonic(), None
            try:
                attack(served.port, Random(f"{seed}-{attack.__name__}"))
                expect_answers(served.port)
            except AssertionError as error:
                problem = str(error)
            if problem := served.problem() or problem:
                wrong.append(f"{page}, {attack.__name__}: {problem}")
            print(f"{page}: {attack.__name__}: {problem or 'ok'} ({time.monotonic() - began:.1f} s)", file=sys.stderr)
        for person in people:
            person.leave()
            wrong += [f"{page}, a person got {problem}" for problem in person.problems]
        wrong += [f"{page}: nobody could work"] if not all(person.kept for person in people) else []
        code = served.stop()
        wrong += [f"{page}: exit code {code}"] if code not in (0, 1, 130) else []
        wrong += _lost(words, folder, people)
        served.start()  # it takes up what there is
        expect_answers(served.port)
        wrong += [f"{page}, started again: {problem}"] if (problem := served.problem()) else []
    finally:
        served.stop()
    return wrong


def _lost(words: Sequence[str], folder: Path, people: Sequence[Person]) -> list[str]:
    """What the page said that it keeps, and did not."""
    if words[0] == "rate":
        found = [(rating.rater, rating.place + 1) for rating in read_ratings(Path(words[1])) if rating.answer == 1]
        return [
            f"rate: answer {place} of {code} is lost"
            for code, person in zip(CODES, people, strict=True)
            for place in person.kept
            if (code, place) not in found
        ]
    data = DataSet.open(folder / "data")
    made = {one.trial: data.demonstration(one.trial) for one in data.trials}
    return [
        f"record: trial {trial} of {code} is lost or changed"
        for code, person in zip(CODES, people, strict=True)
        for trial in person.kept
        if trial not in made or made[trial].demonstrator != f"test-robot {code}" or len(made[trial].goal) != 2
    ]


def main() -> int:
    """Attack both pages; print what is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    names = [attack.__name__ for attack in ATTACKS]
    parser.add_argument("--attacks", nargs="+", choices=names, default=names)
    parser.add_argument("--files", type=int, help="maximum number of files that the commands may have open")
    given = parser.parse_args()
    attacks = [attack for attack in ATTACKS if attack.__name__ in given.attacks]
    commands = (
        ["record", "--out", "data", "--trials", "5000", "--setups", "N1M1", "--foods", "block"],
        ["rate", str(given.run.resolve()), "--pairs", "5000"],
    )
    wrong = []
    for words in commands:
        with tempfile.TemporaryDirectory() as folder:
            wrong += problems_of(words, Path(folder), attacks, given.seed, given.files)
    print("\n".join(wrong) or f"{len(attacks)} attacks on each of {len(commands)} pages: nothing wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
