"""Import: demonstrations that were recorded elsewhere, as files, become a data set."""

import hashlib
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.mesh_io.bodies import one_body
from cutgrammar.geometry.mesh_io.files import MAX_BYTES, read_scan
from cutgrammar.geometry.mesh_io.units import UNITS
from cutgrammar.storage.data_set import DataSet, new_data_set
from cutgrammar.storage.recorded_demonstration import demonstration_of
from cutgrammar.storage.recorded_files import RecordedDemonstration, read_recorded
from cutgrammar_pipelines.config import ImportConfig
from cutgrammar_pipelines.stages.progress import note, progress, status

MAX_READERS = 8
"""Meshes that are parsed at once, each in a process of its own, on a machine with as many cores."""


def import_recorded(config: ImportConfig) -> DataSet:
    """Make a data set of the demonstrations in a folder, one JSON file each, numbered in the order of their names.

    Raises:
        InputError: there are none, one cannot be used, which the message names with its cut, or `out` is in use; no
            data set is made then.
    """
    recorded = _described(config.folder)
    files = {file: [config.folder / mesh for mesh in _meshes_of(one)] for file, one in recorded.items()}
    definition = f"imported: {_digest(recorded, files, config.bodies)}"
    if (config.out / "manifest.json").exists():
        data = DataSet.open(config.out)
        if data.definition == definition:
            status(f"{config.out} already holds these demonstrations: {len(data.trials)} trials; nothing to do")
            return data
        raise InputError(f"{config.out} holds another data set ({len(data.trials)} trials); choose another --out")
    foods = {food.food: "imported" for one in recorded.values() for food in one.objects}
    with (
        new_data_set(config.out, None, None, foods, definition) as add,
        progress("import", len(recorded)) as advance,
        ThreadPoolExecutor(min(os.cpu_count() or 1, MAX_READERS)) as readers,
    ):
        for trial, (file, one) in enumerate(recorded.items()):
            meshes = dict(_read(config, file, one, readers))
            try:
                demonstration, notes = demonstration_of(one, meshes, trial)
            except InputError as error:
                raise InputError(f"{file}: {error}") from None
            for text in notes:
                note(f"{file}: {text}")
            add(demonstration)
            advance()
    data = DataSet.open(config.out)
    setups = ", ".join(f"{number} {setup}" for setup, number in sorted(Counter(t.setup for t in data.trials).items()))
    status(f"{config.out} holds {len(data.trials)} trials ({setups}), {sum(trial.cuts for trial in data.trials)} cuts")
    return data


def _described(folder: Path) -> dict[Path, RecordedDemonstration]:
    """The description of every demonstration in a folder, by its file.

    Raises:
        InputError: there are none, one cannot be read, or it names a mesh outside the folder.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder; give the folder of the demonstrations, one JSON file each")
    files = sorted(folder.glob("*.json"))
    if not files:
        raise InputError(f"{folder} has no JSON file; there is one for each demonstration, see docs/howto/import.md")
    found = {file: read_recorded(file) for file in files}
    for file, one in found.items():
        for mesh, place in _meshes_of(one).items():
            if not (folder / mesh).resolve().is_relative_to(folder.resolve()):
                raise InputError(f"{file}: {place}: the mesh {mesh!r} is outside {folder}; put it into the folder")
    return found


def _meshes_of(recorded: RecordedDemonstration) -> dict[str, str]:
    """Mesh file -> where a demonstration names it first."""
    named = [(one.mesh, f"object {one.name}") for one in recorded.objects]
    for step, cut in enumerate(recorded.cuts, start=1):
        named += [(one.mesh, f"cut {step}, product {one.name}") for one in cut.products if one.mesh is not None]
    return dict(reversed(named))


def _read(
    config: ImportConfig, file: Path, recorded: RecordedDemonstration, readers: ThreadPoolExecutor
) -> Iterator[tuple[str, Mesh]]:
    """The meshes of a demonstration by file name [m], read by the rules of `plan`.

    Raises:
        InputError: one cannot be used.
    """
    scale, places = UNITS[recorded.unit], _meshes_of(recorded)
    waiting = {mesh: readers.submit(read_scan, config.folder / mesh, config.bodies) for mesh in places}
    try:
        for mesh, place in places.items():
            try:
                scan = waiting[mesh].result()
                body = one_body(scan.bodies)
            except InputError as error:
                text = str(error) if str(error).startswith("mesh ") else f"mesh {config.folder / mesh} {error}"
                raise InputError(f"{file}: {place}: {text}") from None
            for text in scan.notes:
                note(f"{file}: {place}: mesh {mesh}: {text}")
            yield mesh, Mesh(body.vertices * scale, body.faces)
    finally:
        for one in waiting.values():
            one.cancel()


def _digest(recorded: Mapping[Path, object], files: Mapping[Path, Sequence[Path]], bodies: str) -> str:
    """sha256 of all that a data set is made of; what cannot be read is left out, and refused when it is used."""
    digest = hashlib.sha256(bodies.encode())
    for file in recorded:
        for one in (file, *files[file]):
            digest.update(one.name.encode())
            if one.is_file() and one.stat().st_size <= MAX_BYTES:
                with suppress(OSError), one.open("rb") as opened:
                    digest.update(hashlib.file_digest(opened, "sha256").digest())
    return digest.hexdigest()
