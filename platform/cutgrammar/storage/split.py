"""Splits: which trials of a data set train and which test (IV-A). They lie in its folder as `splits/NAME.json`.

Rules:
- `paper`: 40 % of N1M1 train (16 of the paper's 40), stratified by category, chosen by a hash; all the rest test.
- `share`: a share of every setup and set of categories trains, chosen by the same hash.
- `food`: trials without the foods held out train, those with one of them test.
"""

import hashlib
import json
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import json_bytes, write_atomic
from cutgrammar.errors import InputError, one_of
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.tables import TrialSummary
from cutgrammar.trials.collection_plan import apportion

RULES = ("paper", "share", "food")
SCHEMA = 1
"""Version of the file; another one is refused."""
TRAINED_SHARE = 0.4
"""Of N1M1, in the paper."""


@dataclass(frozen=True)
class Split:
    """Trials to learn from and trials to be tested on.

    Attributes:
        name: of the split within its data set.
        rule: how it was made, e.g. "paper".
        train, test: numbers of trials, ascending, with none in common.
    """

    name: str
    rule: str
    train: tuple[int, ...]
    test: tuple[int, ...]

    @property
    def digest(self) -> str:
        """sha256 of which trials train and which test."""
        return hashlib.sha256(json_bytes({"train": self.train, "test": self.test})).hexdigest()


def make_split(
    data: DataSet, rule: str = "paper", share: float = TRAINED_SHARE, foods: Sequence[str] = (), name: str | None = None
) -> Split:
    """Split a data set by a rule; a pure function of the trials' facts.

    Args:
        data: the data set.
        rule: one of `RULES`.
        share: that trains, for the rule `share`.
        foods: held out for testing, for the rule `food`; without any, the last by name.
        name: of the split; its rule by default.

    Raises:
        InputError: an unknown rule or food, or a split that leaves nothing to train or to test.
    """
    one_of("rule", rule, RULES)
    if rule == "paper":
        train = _chosen([trial for trial in data.trials if trial.setup == "N1M1"], TRAINED_SHARE)
    elif rule == "share":
        if not 0.0 < share < 1.0:
            raise InputError(f"share {share} of the trials cannot train; a number between 0 and 1 is needed")
        setups = dict.fromkeys(trial.setup for trial in data.trials)
        train = {number for name in setups for number in _chosen([t for t in data.trials if t.setup == name], share)}
    else:
        known = sorted({food for trial in data.trials for food in trial.foods})
        held_out = {one_of("food", food, known) for food in foods} or {known[-1]}
        train = {trial.trial for trial in data.trials if not held_out & set(trial.foods)}
    return _checked(
        Split(
            name=name or rule,
            rule=rule,
            train=tuple(sorted(train)),
            test=tuple(trial.trial for trial in data.trials if trial.trial not in train),
        ),
        data,
    )


def write_split(data: DataSet, split: Split) -> Path:
    """Write a split into the folder of its data set, in place of one of the same name.

    Raises:
        InputError: a name that cannot be a file's, unknown trials, or trials that both train and test.
    """
    file = _file(data, split.name)
    _checked(split, data)
    file.parent.mkdir(exist_ok=True)
    facts = {"schema": SCHEMA, "data": data.digest, "rule": split.rule, "train": split.train, "test": split.test}
    write_atomic(file, json_bytes(facts))
    return file


def read_split(data: DataSet, name: str = "paper") -> Split:
    """The split of that name, without the trials that `data` goes on without.

    Raises:
        InputError: there is none, it belongs to another data set, or it is torn, names unknown trials or some twice.
    """
    file = _file(data, name)
    try:
        facts = json.loads(file.read_bytes())
    except FileNotFoundError:
        known = sorted(other.stem for other in file.parent.glob("*.json"))
        others = f"; it has {', '.join(known)}" if known else ""
        raise InputError(f"{data.path} has no split {name!r}{others}; cutgrammar split makes one") from None
    except (OSError, ValueError) as error:
        raise InputError(f"split {file} is torn ({error}); make it again with cutgrammar split") from None
    if not isinstance(facts, dict) or facts.get("schema") != SCHEMA:
        found = facts.get("schema") if isinstance(facts, dict) else None
        raise InputError(f"split {file} has schema {found!r}, not {SCHEMA}; make it again with cutgrammar split")
    if facts.get("data") != data.digest:
        raise InputError(f"split {file} was made for another data set; make it again with cutgrammar split")
    train, test = _numbers(file, facts, "train"), _numbers(file, facts, "test")
    gone = set(data.missing)
    whole = Split(name, str(facts.get("rule")), train, test)
    _check_trials(whole, {trial.trial for trial in data.trials} | gone, str(file))
    kept = [tuple(trial for trial in trials if trial not in gone) for trials in (train, test)]
    return Split(name, whole.rule, *kept)


def _chosen(trials: Sequence[TrialSummary], share: float) -> set[int]:
    """The numbers of a share of some trials: of each set of categories alike, by lowest hash; at least one."""
    strata: dict[str, list[TrialSummary]] = defaultdict(list)
    for trial in trials:
        strata["+".join(trial.categories)].append(trial)
    if not strata:
        return set()
    total = max(1, round(share * len(trials)))
    counts = apportion(total, {name: len(strata[name]) for name in sorted(strata)})
    return {trial.trial for name, count in counts.items() for trial in sorted(strata[name], key=_hash)[:count]}


def _hash(trial: TrialSummary) -> str:
    """A number at random that the trial's stable facts decide."""
    facts = (trial.seed, trial.demonstrator, trial.trial, trial.setup, trial.foods, trial.categories)
    return hashlib.sha256(repr(facts).encode()).hexdigest()


def _file(data: DataSet, name: str) -> Path:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", name):
        raise InputError(f"split name {name!r} cannot be a file's; use letters, digits, '-', '_' and '.'")
    return data.path / "splits" / f"{name}.json"


def _numbers(file: Path, facts: dict[str, Any], key: str) -> tuple[int, ...]:
    numbers = facts.get(key)
    if not isinstance(numbers, list) or not all(type(number) is int for number in numbers):
        raise InputError(f"split {file} has no list of trials {key!r}; make it again with cutgrammar split")
    return tuple(numbers)


def _check_trials(split: Split, known: Iterable[int], where: str) -> None:
    """Pass if a split names known trials, each once.

    Raises:
        InputError: it does not.
    """
    unknown = sorted({*split.train, *split.test} - set(known))
    if unknown:
        raise InputError(f"{where} names trial {unknown[0]}, which the data set does not have; make the split again")
    both = sorted(set(split.train) & set(split.test))
    if both:
        raise InputError(f"{where}: trial {both[0]} both trains and tests; make the split again")
    for trials in (split.train, split.test):
        if len(set(trials)) < len(trials):
            raise InputError(f"{where} names a trial twice; make the split again")


def _checked(split: Split, data: DataSet) -> Split:
    _check_trials(split, [trial.trial for trial in data.trials], f"split {split.name!r}")
    if not split.train:
        raise InputError(f"rule {split.rule!r} leaves no trial of {data.path} to train; collect N1M1 too, or more")
    if not split.test:
        raise InputError(f"rule {split.rule!r} leaves no trial of {data.path} to test; collect more")
    return split
