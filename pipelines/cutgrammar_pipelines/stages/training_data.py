"""Training data for variants: fewer trials of a split, or further demonstrations; some foods, tested on others."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, zip_longest
from pathlib import Path

from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.split import Split, make_split, read_split, write_split
from cutgrammar_pipelines.config import CollectConfig
from cutgrammar_pipelines.stages.collect import collect
from cutgrammar_pipelines.stages.splitting import merged
from cutgrammar_pipelines.study.variants import Transfer

SPLIT = "paper"
"""The split that a study trains and tests on."""
FURTHER = 1000
"""Added to the study's seed for demonstrations that are not in its data set."""
SAME_FOOD, OTHER_FOOD = "same-food", "other-food"
"""Names of the splits of a transfer: both have the same training trials, and test the same foods or the others."""


def with_training_trials(collected: CollectConfig, number: int, folder: Path) -> tuple[Path, str]:
    """A data set and a split with `number` training trials and the test trials of the study's data set.

    Fewer than in the split are taken in turn over its sets of categories, so that a smaller training set is part of a
    larger one. More are those of the split and further N1M1 demonstrations under another seed; trials keep their
    numbers.

    Args:
        collected: how the study's data set was collected.
        number: number of training trials; 0 for those of the split.
        folder: where further data sets are made.

    Returns:
        Folder of the data set and name of the split.
    """
    data = collected.out
    source = DataSet.open(data)
    known = read_split(source, SPLIT)
    if number in (0, len(known.train)):
        return data, SPLIT
    name = f"train-{number}"
    if number < len(known.train):
        chosen = tuple(sorted(_in_turn(source, known.train)[:number]))
        write_split(source, Split(name, "fewer", chosen, known.test))
        return data, name
    further = number - len(known.train)
    more = collect(
        replace(
            collected,
            out=folder / f"further-{further}",
            trials=further,
            seed=collected.seed + FURTHER,
            setups=("N1M1",),
        )
    )
    both = merged([source, more], folder / name)
    added = tuple(trial.trial for trial in both.trials[len(source.trials) :])
    write_split(both, Split(name, "more", (*known.train, *added), known.test))
    return both.path, name


def transfer_data(collected: CollectConfig, transfer: Transfer, folder: Path) -> Path:
    """A data set with the splits `SAME_FOOD` and `OTHER_FOOD` of a transfer.

    The training trials are those of the paper's rule among the demonstrations with the foods to train on.

    Args:
        collected: how the study's data set was collected.
        transfer: the transfer.
        folder: where data sets are made.
    """
    learned, other = (
        collect(
            replace(
                collected,
                out=folder / f"{transfer.name}-{'-'.join(foods)}",
                trials=transfer.trials,
                setups=transfer.setups,
                foods=foods,
            )
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
    """The trials, taking one of each set of categories in turn."""
    groups: dict[tuple[str, ...], list[int]] = defaultdict(list)
    for trial in sorted(trials):
        groups[source.summary(trial).categories].append(trial)
    rounds = zip_longest(*(groups[categories] for categories in sorted(groups)))
    return [trial for trial in chain.from_iterable(rounds) if trial is not None]
