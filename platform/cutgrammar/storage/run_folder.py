"""The files of a run folder: `run.json`, `ledger.sqlite`, `recordings/`.

`run.json` is written once and says what all trials of the run have in common. An evaluation that differs in any of it
is refused, because its rows do not compare with the existing ones.
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
"""Facts that may differ when a run is resumed: paths, commit and machine."""


@dataclass(frozen=True)
class RunFacts:
    """What the trials of a run have in common.

    Attributes:
        seed: of the evaluation.
        settings: all of them, as plain data.
        data_digest: of the data set.
        missing: trials that are left out since their parts of the data set are missing or torn.
        split: name of the split.
        split_digest: sha256 of which trials train and which test.
        model_digest: of the model.
        package: version of cutgrammar.
        data, model: absolute paths of data set and model.
        commit: of the code, if it is in a git checkout.
        machine: of the driver.
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
        return hashlib.sha256(json_bytes(_deciding(self))).hexdigest()


def ledger_of(run: Path) -> Path:
    """The path of a run's ledger."""
    return run / "ledger.sqlite"


def recording_of(run: Path, name: str) -> Path:
    """The path of a trial's recording, which may not exist; `name` is that of its key."""
    return run / "recordings" / f"{name}.rrd"


def settle_run(run: Path, facts: RunFacts) -> None:
    """Write `run.json`, or check that the existing one agrees.

    Raises:
        InputError: the folder holds a run with other facts, of which the message names the first; or it holds something
            else, or cannot be created.
    """
    file = run / "run.json"
    if not file.exists():
        if ledger_of(run).exists():
            raise InputError(f"{run} has a ledger but no run.json; put it back, or choose another --out")
        _make(run)
        write_atomic(file, json_bytes({"schema": SCHEMA, **dataclasses.asdict(facts)}))
        return
    if changed := difference(read_run(run), facts):
        raise InputError(f"{run} was started with {changed}; give the same, or choose another --out")


def _make(run: Path) -> None:
    try:
        run.mkdir(parents=True, exist_ok=True)
        strange = sorted(entry.name for entry in run.iterdir() if not entry.name.startswith("."))
    except OSError as error:
        raise InputError(f"{run} cannot be created: {error.strerror}; choose another place with --out") from None
    if strange:
        raise InputError(f"{run} is not a run: it holds {strange[0]}; choose another --out")


def difference(existing: RunFacts, facts: RunFacts) -> str | None:
    """The first fact in which `facts` differ from those of an `existing` run, as "NAME = OLD, not NEW"; or None."""
    return first_difference(_deciding(existing), _deciding(facts))


def _deciding(facts: RunFacts) -> dict[str, Any]:
    """All facts that can change a result."""
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
        raise InputError(f"{run} is not a run: it has no run.json; cutgrammar evaluate creates one") from None
    except InputError:
        raise
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{file} is torn or is not a run's ({error}); put a good copy in its place") from None
