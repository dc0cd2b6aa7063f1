"""The files of a run folder: `run.json`, `ledger.sqlite`, `recordings/`.

`run.json` is written once and says what all trials of the run have in common. An evaluation that differs in any of it
is refused, because its rows do not compare with the existing ones.

Trials of one model differ in the seed of planning; of several models, run r uses the model r. The origin of a trial is
the digest of all facts with its own model, so that its key decides its result.
"""

import dataclasses
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import json_bytes, write_atomic
from cutgrammar.errors import InputError
from cutgrammar.storage.differences import first_difference
from cutgrammar.storage.run_schema import as_schema_2, check_run
from cutgrammar.untrusted import check_regular, read_json, shortened
from cutgrammar.untrusted.files import check_inside

SCHEMA = 2
"""Version of `run.json` that is written. Schema 1 had a single model, and can be read; another one is refused."""
READABLE = (1, 2)
INCIDENTAL = ("data", "models", "human", "commit", "machine", "artifacts")
"""Facts that change no result: places, commit and machine."""
OPTIONAL = ("human", "human_digests", "by_robot", "artifacts")
"""Facts that not every run has: those of people's reproductions, and a place for recordings."""
ADDED: Mapping[str, Mapping[str, Any]] = {"trial": {"max_seconds": 3600.0}, "vision": {"seams": False}}
"""Settings that were added since schema 2: table -> name -> the value with which results are those of before. A run
that lacks one was made with that value."""


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
        model_digests: of the models; run r uses the model r, or the only one.
        package: version of cutgrammar.
        data: absolute path of the data set, or its URL.
        models: absolute paths of the models, or their URLs.
        commit: of the code, if it is in a git checkout.
        machine: of the driver.
        human: absolute paths of the data sets with people's reproductions of the goals, or their URLs.
        human_digests: of these data sets.
        by_robot: whether a test robot's reproductions are among them; such a run tests this software, and no report
            takes it.
        artifacts: folder or URL that recordings are written to; None for the run's own folder.
    """

    seed: int
    settings: Mapping[str, Any]
    data_digest: str
    missing: tuple[int, ...]
    split: str
    split_digest: str
    model_digests: tuple[str, ...]
    package: str
    data: str
    models: tuple[str, ...]
    commit: str | None
    machine: Mapping[str, Any]
    human: tuple[str, ...] = ()
    human_digests: tuple[str, ...] = ()
    by_robot: bool = False
    artifacts: str | None = None

    @cached_property
    def origins(self) -> tuple[str, ...]:
        """For each model, the digest of all that can change a result of its trials."""
        facts = {name: value for name, value in _deciding(self).items() if name != "model_digests"}
        return tuple(
            hashlib.sha256(json_bytes({**facts, "model_digest": digest})).hexdigest() for digest in self.model_digests
        )

    @property
    def origin(self) -> str:
        """Digest of all that can change a result of the whole run."""
        if len(self.origins) == 1:
            return self.origins[0]
        return hashlib.sha256("".join(self.origins).encode()).hexdigest()

    def origin_of(self, run: int) -> str:
        """The origin of the trials of run number `run`."""
        return self.origins[run if len(self.origins) > 1 else 0]

    def model_of(self, origin: str) -> int:
        """Number of the model that the trials of `origin` used.

        Raises:
            ValueError: no model of this run has trials of that origin.
        """
        return self.origins.index(origin)


def refuse_test_robots(facts: Mapping[Path, RunFacts]) -> None:
    """Refuse runs that repeat what a test robot did, from which no table, picture or published file is made.

    Args:
        facts: of each run folder.

    Raises:
        InputError: one of them is such a run.
    """
    for run, of_run in facts.items():
        if of_run.by_robot:
            raise InputError(
                f"{run.name} was made to test this software: its method human repeats what a test robot did, which "
                "enters no table; evaluate what people did, without --test-robots"
            )


def ledger_of(run: Path) -> Path:
    """The path of a run's ledger."""
    return run / "ledger.sqlite"


def recording_of(run: Path, name: str) -> Path:
    """The path of a trial's recording, which may not exist; `name` is that of its key."""
    return run / "recordings" / f"{name}.rrd"


def recordings_of(run: Path) -> list[Path]:
    """The paths of all recordings of a run, as `recording_of` gives them, in any order."""
    return list((run / "recordings").glob("*.rrd"))


def place_for_recording(run: Path, name: str) -> Path:
    """The same in a folder that exists, for writing.

    Raises:
        InputError: a link leads out of the run's folder.
    """
    file = recording_of(run, name)
    check_inside(file, run)
    file.parent.mkdir(exist_ok=True)
    return file


def known_recording(run: Path, name: str) -> Path | None:
    """The path of a trial's recording; None if there is none.

    Raises:
        InputError: what is there is no ordinary file.
    """
    file = recording_of(run, name)
    if not file.exists():
        return None
    check_regular(file)
    return file


def recordings_elsewhere(facts: RunFacts, origin: str) -> str | None:
    """The folder or URL of the recordings of trials of one origin; None if they are in the run's folder."""
    return None if facts.artifacts is None else f"{facts.artifacts.rstrip('/')}/{origin[:16]}"


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
        write_atomic(file, json_bytes({"schema": SCHEMA, **_written(facts)}))
        return
    existing = read_run(run)
    if changed := difference(existing, facts):
        raise InputError(f"{run} was started with {changed}; give the same, or choose another --out")
    if existing.artifacts != facts.artifacts:
        given = f"--artifacts {existing.artifacts}" if existing.artifacts else "no --artifacts"
        raise InputError(f"{run} was started with {given}; give the same, or choose another --out")


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
    old, new = (
        {**_deciding(one), "model_digests": _numbered(one.model_digests), "settings": _completed(one.settings)}
        for one in (existing, facts)
    )
    return first_difference(old, new)


def resumed(run: Path, facts: RunFacts) -> RunFacts:
    """These facts with the settings as the run in folder `run` wrote them, if it is the same run.

    Its trials then keep their origin where a later release added settings.

    Raises:
        InputError: its `run.json` is torn.
    """
    if not (run / "run.json").exists():
        return facts
    existing = read_run(run)
    return facts if difference(existing, facts) else dataclasses.replace(facts, settings=existing.settings)


def _completed(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings with those that their release did not have."""
    return {
        table: {**ADDED.get(table, {}), **values} if isinstance(values, Mapping) else values
        for table, values in settings.items()
    }


def _numbered(digests: Sequence[str]) -> dict[str, str]:
    """The digests of models by their numbers, so that a difference names the first that differs."""
    return {str(number): digest for number, digest in enumerate(digests)}


def _deciding(facts: RunFacts) -> dict[str, Any]:
    """All facts that can change a result."""
    return {name: value for name, value in _written(facts).items() if name not in INCIDENTAL}


def _written(facts: RunFacts) -> dict[str, Any]:
    """The facts as they are written; a run without optional facts has the digest that it had before there were any."""
    every = dataclasses.asdict(facts)
    return {name: value for name, value in every.items() if value or name not in OPTIONAL}


def read_run(run: Path) -> RunFacts:
    """The facts of the run in folder `run`.

    Raises:
        InputError: no run, another schema version, or a torn file.
    """
    file = run / "run.json"
    try:
        facts = read_json(file)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{run} is not a run: it has no run.json; cutgrammar evaluate creates one") from None
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(f"{file} is torn or is not a run's ({error}); put a good copy in its place") from None
    schema = facts.pop("schema", None) if isinstance(facts, dict) else None
    if type(schema) is not int or schema not in READABLE:
        raise InputError(f"{file} has schema {shortened(schema)}, not {SCHEMA}; evaluate into a new folder")
    facts = as_schema_2(facts) if schema == 1 else facts
    try:
        check_run(facts)
        lists = {name: tuple(value) for name, value in facts.items() if isinstance(value, list)}
        return RunFacts(**facts | lists)
    except (ValueError, TypeError) as error:
        raise InputError(f"{file} is not a run's: {error}; put a good copy in its place") from None
