"""`manifest.json` of a data set: how the set was made, and the sha256 of every part."""

import dataclasses
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import json_bytes, write_atomic
from cutgrammar.errors import InputError
from cutgrammar.storage.manifest_schema import MANIFEST
from cutgrammar.storage.tables import ALL_SCHEMAS, SCHEMAS
from cutgrammar.untrusted import check, check_regular, parse_json, read_regular, shortened
from cutgrammar.untrusted.documents import MAX_JSON

SCHEMA = 1
"""Version of the folder's format; others are refused."""
MAX_PART_BYTES = 2_000_000_000
"""Most bytes of a part of a table: 40 MB for each of its 50 trials."""


def reproduction_of(digest: str) -> str:
    """The definition of a data set in which people reproduce the goals of the data set with this digest."""
    return f"by hand: reproduces {digest}"


@dataclass(frozen=True)
class Part:
    """The rows of some trials in every table.

    Attributes:
        number: number of the part.
        trials: the numbers of its trials, ascending.
        sha256: table -> digest of its file.
    """

    number: int
    trials: tuple[int, ...]
    sha256: Mapping[str, str]

    @staticmethod
    def of(folder: Path, number: int, trials: tuple[int, ...]) -> "Part":
        """The part with this number in `folder`, with all tables that it has."""
        files = {table: folder / part_path(table, number) for table in ALL_SCHEMAS}
        has = {table: file for table, file in files.items() if table in SCHEMAS or file.exists()}
        return Part(number, trials, {table: digest_of(file) for table, file in has.items()})

    def problem(self, folder: Path) -> str | None:
        """What is wrong with this part in `folder`, or None."""
        for table in self.sha256:
            file = part_path(table, self.number)
            try:
                check_regular(folder / file, MAX_PART_BYTES)
            except FileNotFoundError:
                return f"{file} is missing"
            except InputError as error:
                return str(error).removeprefix(f"{folder}/")
            except OSError as error:
                return f"{file} cannot be read: {error.strerror}"
            if digest_of(folder / file) != self.sha256[table]:
                return f"{file} is damaged or foreign: its sha256 differs from the manifest's"
        return None


@dataclass(frozen=True)
class Manifest:
    """How a data set was made and what belongs to it.

    Attributes:
        settings: the demonstrator's settings by name; None for a merged or imported set.
        seed: the seed that it was made from; None for a merged or imported set.
        definition: digest of the demonstrator's definition; None for a merged set or if it is unknown.
        foods: food name -> its source.
        sources: digest, settings, seed, foods and number of trials of the sets it was merged from.
        parts: the parts by ascending number.
    """

    settings: Mapping[str, Any] | None
    seed: int | None
    definition: str | None
    foods: Mapping[str, str]
    sources: tuple[Mapping[str, Any], ...]
    parts: tuple[Part, ...]

    def write(self, folder: Path) -> None:
        """Write or replace `manifest.json`."""
        facts = {"schema": SCHEMA, "cutgrammar": version("cutgrammar"), **dataclasses.asdict(self)}
        write_atomic(folder / "manifest.json", json_bytes(facts))

    def refuse_foreign(self, folder: Path) -> None:
        """Check that the tables' folders contain only files of this manifest.

        Raises:
            InputError: there is another file.
        """
        known = {part_path(table, part.number) for part in self.parts for table in part.sha256}
        for table in ALL_SCHEMAS:
            for file in sorted((folder / table).glob("*")):
                found = file.relative_to(folder)
                if found not in known and not file.name.startswith("."):
                    raise InputError(f"{folder}: {found} is foreign, the manifest does not list it; remove it")


def read_manifest(folder: Path) -> tuple[Manifest, str]:
    """The manifest of the data set in `folder`, and its digest.

    Raises:
        InputError: there is none, it is damaged, or it has another schema version.
    """
    file = folder / "manifest.json"
    if not folder.exists():
        raise InputError(f"data set {folder} does not exist; make one with cutgrammar collect --out {folder}")
    try:
        content = read_regular(file, MAX_JSON)
        facts = parse_json(content)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{folder} is not a data set: it has no manifest.json; cutgrammar collect makes one") from None
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(f"{file} is damaged or is not a data set's ({error}); collect again") from None
    found = facts.get("schema") if isinstance(facts, dict) else None
    if type(found) is int and found != SCHEMA:
        raise InputError(
            f"{file} has schema {shortened(found)}, written by cutgrammar {str(facts.get('cutgrammar', '?'))[:40]};"
            f" this version reads schema {SCHEMA}: collect again, or use that version"
        )
    try:
        check(MANIFEST, facts)
    except ValueError as error:
        raise InputError(f"{file} is not a data set's: {error}; collect again") from None
    manifest = Manifest(
        settings=facts["settings"],
        seed=facts["seed"],
        definition=facts["definition"],
        foods=facts["foods"],
        sources=tuple(facts["sources"]),
        parts=tuple(Part(part["number"], tuple(part["trials"]), part["sha256"]) for part in facts["parts"]),
    )
    return manifest, hashlib.sha256(content).hexdigest()


def part_path(table: str, number: int) -> Path:
    """The path of part `number` of a table, relative to the data set."""
    return Path(table, f"part-{number:05d}.parquet")


def digest_of(file: Path) -> str:
    """The sha256 of a file."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
