"""Split: which trials of a data set train and which test; several data sets become one first."""

from collections.abc import Sequence
from pathlib import Path

from cutgrammar.errors import InputError
from cutgrammar.storage.data_set import DataSet, merge
from cutgrammar.storage.split import TRAINING_SHARE, Split, make_split, write_split


def split(
    data: Sequence[Path], out: Path, rule: str = "paper", share: float = TRAINING_SHARE, foods: Sequence[str] = ()
) -> Split:
    """Write a split into the data set `out`, which is one of `data` by itself or is made by merging them.

    Args:
        data: folders of data sets.
        out: the same folder, where there is one; else a folder to make. If it holds the very same merged data set
            already, only the split is written.
        rule: see `cutgrammar.storage.split`.
        share: that trains, for the rule `share`.
        foods: held out, for the rule `food`.

    Raises:
        InputError: a data set or the split cannot be used, or `out` is in use.
    """
    sets = [DataSet.open(path) for path in data]
    if not sets:
        raise InputError("no data set was given to split")
    if len(sets) == 1 and out.resolve() == data[0].resolve():
        chosen = sets[0]
    else:
        if any(out.resolve() == path.resolve() for path in data):
            raise InputError(f"{out} is one of the data sets to merge; choose another --out")
        chosen = merged(sets, out)
    made = make_split(chosen, rule, share, foods)
    file = write_split(chosen, made)
    print(f"{file}: {len(made.train)} trials train, {len(made.test)} test")
    return made


def merged(sets: Sequence[DataSet], out: Path) -> DataSet:
    """The data sets merged into one in the folder `out`; if it is there already, nothing is done.

    Raises:
        InputError: `out` is in use, or a part cannot be read.
    """
    there = (out / "manifest.json").exists() and DataSet.open(out).sources == tuple(data.digest for data in sets)
    if not there:
        merge(sets, out)
    return DataSet.open(out)
