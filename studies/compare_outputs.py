"""Compare what two versions of cutgrammar made of the same commands: data set, model and records.

    python studies/compare_outputs.py OLD NEW

OLD and NEW are folders with `data`, `model` and one or more run folders, as `cutgrammar study` or these commands make:

    cutgrammar collect  --out data
    cutgrammar split    data --out data
    cutgrammar train    --data data --out model
    cutgrammar evaluate --data data --model model --out run --world bench --trials 2 --runs 1

Compared are the bytes of every data part, split and weight file, the grammar and the training metrics, and every record
but for times and what describes the format rather than the trial (key digests, package version, names of fields). The
script imports nothing of cutgrammar, so the two sides may be of versions that cannot read each other's files.
It prints one line a comparison and exits with 1 if anything differs.
"""

import argparse
import hashlib
import json
import sqlite3
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

SCORES = ("iou", "iou_strict", "iou_refined", "spectral", "agreement")
OUTCOME = ("status", "reason", "fragments", "goal_fragments", "cuts", "refusals", "dead_ends")
TIMES = ("seconds", "planning_seconds")


def digests(folder: Path, pattern: str) -> dict[str, str]:
    """The sha256 of every file under `folder` that matches `pattern`, by its relative path."""
    files = sorted(folder.rglob(pattern))
    return {str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def results(ledger: Path) -> dict[str, dict[str, Any]]:
    """The compared content of every record of a ledger, by setup, trial, goals, method, run, world and perception."""
    connection = sqlite3.connect(f"file:{ledger}?mode=ro", uri=True)
    compared = {}
    for (text,) in connection.execute("SELECT record FROM records"):
        record = json.loads(text)
        key = "-".join(str(value) for name, value in record["key"].items() if name != "origin")
        scores = record.get("scores") or {name: record[name] for name in SCORES}
        events = [dict(plain(event)) for event in record["events"]]
        compared[key] = {name: record[name] for name in OUTCOME} | {name: scores[name] for name in SCORES}
        compared[key]["events"] = events
    return compared


def plain(event: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """The facts of one event without its times; scores are fields of it, whether or not the record nests them."""
    for name, value in event.items():
        if name == "scores":
            yield from value.items()
        elif name not in TIMES:
            yield name, value


def compare(what: str, old: dict[str, Any], new: dict[str, Any]) -> bool:
    """Print how many entries of two mappings are equal, and the first that differ."""
    different = sorted(name for name in old.keys() | new.keys() if old.get(name) != new.get(name))
    print(
        f"{what:24} {len(old.keys() & new.keys()) - len(set(different) & old.keys() & new.keys())} of {len(old)} equal"
    )
    for name in different[:5]:
        print(f"    {name}: {str(old.get(name))[:200]}\n    {'became':>{len(name)}}: {str(new.get(name))[:200]}")
    return not different


def main() -> int:
    """Compare the two folders named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path, metavar="OLD")
    parser.add_argument("new", type=Path, metavar="NEW")
    chosen = parser.parse_args()
    old, new = chosen.old, chosen.new
    equal = [
        compare("data set: parts", digests(old / "data", "*.parquet"), digests(new / "data", "*.parquet")),
        compare("data set: splits", *(split_of(side / "data" / "splits" / "paper.json") for side in (old, new))),
        compare("model: weights", digests(old / "model", "*.safetensors"), digests(new / "model", "*.safetensors")),
        compare("model: grammar", *(json_of(side / "model" / "grammar.json") for side in (old, new))),
        compare("model: metrics", *(json_of(side / "model" / "model.json")["metrics"] for side in (old, new))),
    ]
    runs = sorted(file.parent.name for file in old.glob("*/ledger.sqlite"))
    equal += [
        compare(f"{run}: records", *(results(side / run / "ledger.sqlite") for side in (old, new))) for run in runs
    ]
    return 0 if all(equal) else 1


def split_of(file: Path) -> dict[str, Any]:
    """A split without the digest of its data set, which covers the package version."""
    return {name: value for name, value in json_of(file).items() if name != "data"}


def json_of(file: Path) -> dict[str, Any]:
    """The object in a JSON file."""
    content: dict[str, Any] = json.loads(file.read_bytes())
    return content


if __name__ == "__main__":
    sys.exit(main())
