"""A data set that grows by one trial at a time, as people make demonstrations.

Every trial is a part of its own. Its files are complete before the manifest, which is replaced atomically, lists them.
A process that dies between the two leaves files that the manifest does not list; adding the trial again repairs this.
"""

import dataclasses
from pathlib import Path

from cutgrammar.demonstration import Demonstration
from cutgrammar.storage.data_set import write_tables
from cutgrammar.storage.manifest import Manifest, part_path, read_manifest
from cutgrammar.storage.tables import ALL_SCHEMAS, SCHEMAS, tables_of


def trials_in(folder: Path) -> frozenset[int]:
    """The trials that the data set in `folder` holds; none if there is no data set yet.

    Raises:
        InputError: the manifest is damaged.
    """
    if not (folder / "manifest.json").exists():
        return frozenset()
    manifest, _ = read_manifest(folder)
    return frozenset(trial for part in manifest.parts for trial in part.trials)


def add_trial(folder: Path, demonstration: Demonstration, facts: Manifest) -> None:
    """Add a demonstration to the data set in `folder`, which the first one creates.

    Args:
        folder: an existing folder.
        demonstration: replaces what the data set holds under the same trial number.
        facts: how the set is made; its parts are not used.

    Raises:
        InputError: the manifest is damaged.
        OSError: the disk is full, or cannot be written; the data set is as before.
    """
    parts = {part.number: part for part in read_manifest(folder)[0].parts} if trials_in(folder) else {}
    for table in SCHEMAS:
        (folder / table).mkdir(exist_ok=True)
    number = demonstration.trial
    is_new = number not in parts
    try:
        parts[number] = write_tables(folder, number, {number: tables_of(demonstration)})
        dataclasses.replace(facts, parts=tuple(parts[n] for n in sorted(parts))).write(folder)
    except OSError:
        for table in ALL_SCHEMAS if is_new else ():
            (folder / part_path(table, number)).unlink(missing_ok=True)
        raise
