"""What a data set says of itself in `manifest.json`: how it was made, and the sha256 of every part."""

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import json_bytes
from cutgrammar.errors import InputError
from cutgrammar.storage.tables import SCHEMAS

SCHEMA = 1
"""Version of what lies in the folder; another one is refused."""


@dataclass(frozen=True)
class Part:
    """The rows of some trials in every table.

    Attributes:
        number: of the part.
        trials: those it holds, ascending.
        sha256: table -> digest of its file.
    """

    number: int
    trials: tuple[int, ...]
    sha256: Mapping[str, str]

    @staticmethod
    def of(folder: Path, number: int, trials: tuple[int, ...]) -> "Part":
        """The part as it lies in `folder`."""
        return Part(number, trials, {table: digest_of(folder / place(table, number)) for table in SCHEMAS})

    def trouble(self, folder: Path) -> str | None:
        """What is wrong with this part in `folder`, if something is."""
        for table in SCHEMAS:
            file = place(table, self.number)
            if not (folder / file).is_file():
                return f"{file} is missing"
            if digest_of(folder / file) != self.sha256[table]:
                return f"{file} is torn or foreign: its sha256 is not the manifest's"
        return None


@dataclass(frozen=True)
class Manifest:
    """How a data set was made and what belongs to it.

    Attributes:
        settings: what the demonstrator was set to, by name; None for a merged set.
        seed: what it was made from; None for a merged set.
        definition: digest of what defines the demonstrator; None for a merged set or where it is not known.
        foods: name of a food -> what stands behind it.
        sources: digest, settings, seed, foods and number of trials of the sets it was merged from.
        parts: by ascending number.
    """

    settings: Mapping[str, Any] | None
    seed: int | None
    definition: str | None
    foods: Mapping[str, str]
    sources: tuple[Mapping[str, Any], ...]
    parts: tuple[Part, ...]

    def write(self, folder: Path) -> None:
        """Write `manifest.json`."""
        facts = {"schema": SCHEMA, "cutgrammar": version("cutgrammar"), **dataclasses.asdict(self)}
        (folder / "manifest.json").write_bytes(json_bytes(facts))

    def refuse_foreign(self, folder: Path) -> None:
        """Pass if the tables' folders hold nothing that this manifest does not know.

        Raises:
            InputError: they do.
        """
        known = {place(table, part.number) for part in self.parts for table in SCHEMAS}
        for table in SCHEMAS:
            for file in sorted((folder / table).glob("*")):
                found = file.relative_to(folder)
                if found not in known and not file.name.startswith("."):
                    raise InputError(f"{folder}: {found} is foreign, the manifest does not know it; take it away")


def read_manifest(folder: Path) -> tuple[Manifest, str]:
    """The manifest of the data set in `folder`, and its digest.

    Raises:
        InputError: there is none, it is torn, or it has another schema version.
    """
    file = folder / "manifest.json"
    if not folder.exists():
        raise InputError(f"data set {folder} does not exist; make one with cutgrammar collect --out {folder}")
    try:
        content = file.read_bytes()
        facts = json.loads(content)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{folder} is not a data set: it has no manifest.json; cutgrammar collect makes one") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{file} is torn or is not a data set's ({error}); collect again") from None
    found = facts.get("schema") if isinstance(facts, dict) else None
    if isinstance(found, int) and found != SCHEMA:
        raise InputError(
            f"{folder} has schema {found}, written by cutgrammar {facts.get('cutgrammar', '?')};"
            f" this version reads schema {SCHEMA}: collect again, or use that version"
        )
    try:
        manifest = Manifest(
            settings=facts["settings"],
            seed=facts["seed"],
            definition=facts["definition"],
            foods=dict(facts["foods"]),
            sources=tuple({**source, "digest": str(source["digest"])} for source in facts["sources"]),
            parts=tuple(
                Part(int(part["number"]), tuple(map(int, part["trials"])), {t: str(part["sha256"][t]) for t in SCHEMAS})
                for part in facts["parts"]
            ),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{file} is not a data set's ({type(error).__name__}: {error}); collect again") from None
    return manifest, hashlib.sha256(content).hexdigest()


def place(table: str, number: int) -> Path:
    """Where part `number` of a table lies in its data set."""
    return Path(table, f"part-{number:05d}.parquet")


def digest_of(file: Path) -> str:
    """sha256 of a file."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
