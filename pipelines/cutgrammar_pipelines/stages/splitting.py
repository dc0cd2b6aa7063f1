"""Split: which trials of a data set train and which test; several data sets are first merged into one."""

from collections.abc import Sequence
from pathlib import Path

from cutgrammar.errors import InputError
from cutgrammar.storage.data_set import DataSet, merge
from cutgrammar.storage.shared_storage import local_folder
from cutgrammar.storage.split import Split, make_split, write_split
from cutgrammar_pipelines.config import SplitConfig
from cutgrammar_pipelines.stages.progress import status


def split(config: SplitConfig) -> Split:
    """Write a split into a data set, which is `config.data` itself or is made by merging several.

    If `config.out` already holds the merged data set, only the split is written.

    Raises:
        InputError: a data set or the split cannot be used, or `config.out` is in use.
    """
    data, out = [local_folder(place) for place in config.data], config.out
    sets = [DataSet.open(path) for path in data]
    if len(sets) == 1 and out.resolve() == data[0].resolve():
        chosen = sets[0]
    else:
        if any(out.resolve() == path.resolve() for path in data):
            raise InputError(f"{out} is one of the data sets to merge; choose another --out")
        chosen = merged(sets, out)
    made = make_split(chosen, config.rule, config.share, config.foods)
    file = write_split(chosen, made)
    status(f"{file}: {len(made.train)} trials train, {len(made.test)} test")
    return made


def merged(sets: Sequence[DataSet], out: Path) -> DataSet:
    """The data sets merged into one in the folder `out`; if it already exists, nothing is done.

    Raises:
        InputError: `out` is in use, or a part cannot be read.
    """
    exists = (out / "manifest.json").exists() and DataSet.open(out).sources == tuple(data.digest for data in sets)
    if not exists:
        merge(sets, out)
    return DataSet.open(out)
