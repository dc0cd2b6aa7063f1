"""What lies in a run folder: `run.json`, `ledger.sqlite`, `recordings/`.

`run.json` is written once and says what all trials of the run have in common. An evaluation that would differ in any of
it is refused: its rows could not stand in one table with those that are there.
"""

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import json_bytes, write_atomic
from cutgrammar.errors import InputError
from cutgrammar.storage.differences import first_difference

SCHEMA = 1
"""Version of `run.json`; another one is refused."""
INCIDENTAL = ("data", "model", "commit", "machine")
"""Facts that may differ when a run is gone on with: where things lie, and on what they run."""


@dataclass(frozen=True)
class RunFacts:
    """What the trials of a run have in common.

    Attributes:
        seed: of the evaluation.
        settings: all of them, as plain data.
        data_digest: of the data set.
        missing: trials that the data set goes on without.
        split: name of the split.
        split_digest: sha256 of which trials train and which test.
        model_digest: of the model.
        package: version of cutgrammar.
        data, model: where data set and model lay, as absolute paths.
        commit: of the code, where it lies in a git checkout.
        machine: what the driver ran on.
    """

    seed: int
    settings: Mapping[str, Any]
    data_digest: str
    missing: tuple[int, ...]
    split: str
    split_digest: str
    model_digest: str
    package: str
    data: str
    model: str
    commit: str | None
    machine: Mapping[str, Any]

    @property
    def origin(self) -> str:
        """Digest of all that can change a result."""
        return hashlib.sha256(json_bytes(_telling(self))).hexdigest()


def ledger_of(run: Path) -> Path:
    """Where the ledger of a run lies."""
    return run / "ledger.sqlite"


def recording_of(run: Path, name: str) -> Path:
    """Where the recording of a trial lies, if there is one; `name` is that of its key."""
    return run / "recordings" / f"{name}.rrd"


def settle_run(run: Path, facts: RunFacts) -> None:
    """Write `run.json`, or check that the one that is there says the same.

    Raises:
        InputError: the folder holds a run with other facts, and the message names the first that differs; or it holds
            something else, or cannot be made.
    """
    file = run / "run.json"
    if not file.exists():
        if ledger_of(run).exists():
            raise InputError(f"{run} has a ledger but no run.json; put it back, or choose another --out")
        _make(run)
        write_atomic(file, json_bytes({"schema": SCHEMA, **dataclasses.asdict(facts)}))
        return
    if told := difference(read_run(run), facts):
        raise InputError(f"{run} was begun with {told}; give the same, or choose another --out")


def _make(run: Path) -> None:
    try:
        run.mkdir(parents=True, exist_ok=True)
        strange = sorted(entry.name for entry in run.iterdir() if not entry.name.startswith("."))
    except OSError as error:
        raise InputError(f"{run} cannot be made: {error.strerror}; choose another place with --out") from None
    if strange:
        raise InputError(f"{run} is not a run: it holds {strange[0]}; choose another --out")


def difference(there: RunFacts, facts: RunFacts) -> str | None:
    """The first fact that keeps the trials of `facts` out of the run `there`, as "NAME = OLD, not NEW", if any does."""
    return first_difference(_telling(there), _telling(facts))


def _telling(facts: RunFacts) -> dict[str, Any]:
    """All that can change a result."""
    return {name: value for name, value in dataclasses.asdict(facts).items() if name not in INCIDENTAL}


def read_run(run: Path) -> RunFacts:
    """The facts of the run in folder `run`.

    Raises:
        InputError: no run, another schema version, or a torn file.
    """
    file = run / "run.json"
    try:
        facts = json.loads(file.read_bytes())
        if (schema := facts.pop("schema")) != SCHEMA:
            raise InputError(f"{file} has schema {schema!r}, not {SCHEMA}; evaluate into a new folder")
        return RunFacts(**{**facts, "missing": tuple(facts["missing"])})
    except FileNotFoundError:
        raise InputError(f"{run} is not a run: it has no run.json; cutgrammar evaluate makes one") from None
    except InputError:
        raise
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{file} is torn or is not a run's ({error}); put a good copy in its place") from None
