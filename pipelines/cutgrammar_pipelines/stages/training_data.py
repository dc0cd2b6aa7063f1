"""Training data for variants: fewer trials of a split, or more, demonstrated anew; some foods, tested on others."""

from collections import defaultdict
from collections.abc import Sequence
from itertools import chain, zip_longest
from pathlib import Path

from cutgrammar.settings import Settings
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.split import Split, make_split, read_split, write_split
from cutgrammar_pipelines.stages.collect import collect
from cutgrammar_pipelines.stages.splitting import merged
from cutgrammar_pipelines.study.variants import Transfer

SPLIT = "paper"
"""The split that a study trains and tests on."""
FURTHER = 1000
"""Added to the study's seed for demonstrations that its own data set does not have."""
SAME_FOOD, OTHER_FOOD = "same-food", "other-food"
"""Names of the splits of a transfer: both train alike, and test the foods trained on or the others."""


def with_training_trials(
    data: Path,
    number: int,
    folder: Path,
    *,
    seed: int,
    workers: int,
    address: str | None = None,
    settings: Settings | None = None,
) -> tuple[Path, str]:
    """A data set and a split with that many training trials and the test trials of `data`.

    Fewer than the split has are taken in turn over its sets of categories, so that a smaller training set lies within a
    larger one. More are those of the split and further N1M1 demonstrations under another seed; trials keep their
    numbers.

    Args:
        data: the study's data set.
        number: of training trials; 0 for those of the split.
        folder: where further data sets are made.
        seed: of the study.
        workers, address, settings: of `collect`.

    Returns:
        Folder of the data set and name of the split.
    """
    source = DataSet.open(data)
    known = read_split(source, SPLIT)
    if number in (0, len(known.train)):
        return data, SPLIT
    name = f"train-{number}"
    if number < len(known.train):
        chosen = tuple(sorted(_in_turn(source, known.train)[:number]))
        write_split(source, Split(name, "fewer", chosen, known.test))
        return data, name
    more = collect(
        folder / f"further-{number - len(known.train)}",
        trials=number - len(known.train),
        seed=seed + FURTHER,
        setups=["N1M1"],
        workers=workers,
        address=address,
        settings=settings,
    )
    both = merged([source, more], folder / name)
    added = tuple(trial.trial for trial in both.trials[len(source.trials) :])
    write_split(both, Split(name, "more", (*known.train, *added), known.test))
    return both.path, name


def transfer_data(
    transfer: Transfer, folder: Path, *, seed: int, workers: int, address: str | None = None, settings: Settings
) -> Path:
    """A data set with the splits `SAME_FOOD` and `OTHER_FOOD` of a transfer.

    The trials that train are those of the paper's rule among the demonstrations with the foods to learn from.

    Args:
        transfer: what it asks for.
        folder: where data sets are made.
        seed: of the study.
        workers, address, settings: of `collect`.
    """
    learned, other = (
        collect(
            folder / f"{transfer.name}-{'-'.join(foods)}",
            trials=transfer.trials,
            seed=seed,
            setups=transfer.setups,
            foods=foods,
            workers=workers,
            address=address,
            settings=settings,
        )
        for foods in (transfer.train_foods, transfer.test_foods)
    )
    first = make_split(learned)
    both = merged([learned, other], folder / transfer.name)
    others = tuple(trial.trial for trial in both.trials[len(learned.trials) :])
    write_split(both, Split(SAME_FOOD, "transfer", first.train, first.test))
    write_split(both, Split(OTHER_FOOD, "transfer", first.train, others))
    return both.path


def _in_turn(source: DataSet, trials: Sequence[int]) -> list[int]:
    """The trials, in turn one of each set of categories."""
    groups: dict[tuple[str, ...], list[int]] = defaultdict(list)
    for trial in sorted(trials):
        groups[source.summary(trial).categories].append(trial)
    rounds = zip_longest(*(groups[categories] for categories in sorted(groups)))
    return [trial for trial in chain.from_iterable(rounds) if trial is not None]
