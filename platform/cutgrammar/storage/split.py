"""Splits of a data set into training and test trials (IV-A), stored in its folder as `splits/NAME.json`.

Rules:
- `paper`: 40 % of N1M1 (16 of the paper's 40) are training trials, stratified by category and selected by a hash; all
  others are test trials.
- `share`: a share of every setup and set of categories are training trials, selected by the same hash.
- `food`: trials with a held-out food are test trials, all others training trials.
"""

import hashlib
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter, with_config
from typing_extensions import TypedDict

from cutgrammar.atomic_files import json_bytes, write_atomic
from cutgrammar.errors import InputError, listed, one_of
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.tables import TrialSummary
from cutgrammar.trials.collection_plan import apportion
from cutgrammar.untrusted import check, read_json, shortened
from cutgrammar.untrusted.files import check_inside
from cutgrammar.untrusted.kinds import STRICT, Sha256, Small, Word

RULES = ("paper", "share", "food")
SCHEMA = 1
"""Version of the file format; others are refused."""
TRAINING_SHARE = 0.4
"""Share of N1M1 in the training set, as in the paper."""


@with_config(STRICT)
class SplitFacts(TypedDict):
    """The content of a file: see `Split`."""

    schema: int
    data: Sha256
    rule: Word
    train: Annotated[list[Small], Field(min_length=1)]
    test: Annotated[list[Small], Field(min_length=1)]


SPLIT = TypeAdapter(SplitFacts)


@dataclass(frozen=True)
class Split:
    """Training and test trials.

    Attributes:
        name: name of the split within its data set.
        rule: the rule that it was made by, e.g. "paper".
        train, test: numbers of the trials, ascending and disjoint.
    """

    name: str
    rule: str
    train: tuple[int, ...]
    test: tuple[int, ...]

    @property
    def digest(self) -> str:
        """sha256 of the training and test trials."""
        return hashlib.sha256(json_bytes({"train": self.train, "test": self.test})).hexdigest()


def make_split(
    data: DataSet,
    rule: str = "paper",
    share: float = TRAINING_SHARE,
    foods: Sequence[str] = (),
    name: str | None = None,
) -> Split:
    """Split a data set by a rule; the result depends only on the summaries of the trials.

    Args:
        data: the data set.
        rule: one of `RULES`.
        share: share of training trials, for the rule `share`.
        foods: held-out foods, for the rule `food`; the last by name if there is none.
        name: name of the split; by default its rule.

    Raises:
        InputError: a rule or food is unknown, or there would be no training or no test trials.
    """
    one_of("rule", rule, RULES)
    if rule == "paper":
        train = _select([trial for trial in data.trials if trial.setup == "N1M1"], TRAINING_SHARE)
    elif rule == "share":
        if not 0.0 < share < 1.0:
            raise InputError(f"share {share} of training trials is invalid; a number between 0 and 1 is needed")
        setups = dict.fromkeys(trial.setup for trial in data.trials)
        train = {number for name in setups for number in _select([t for t in data.trials if t.setup == name], share)}
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
    """Write a split into the folder of its data set; a split of the same name is replaced.

    Raises:
        InputError: the name is not a valid file name, a trial is unknown, or a trial is in both sets.
    """
    file = _file(data, split.name)
    _checked(split, data)
    file.parent.mkdir(exist_ok=True)
    check_inside(file, data.path)
    facts = {"schema": SCHEMA, "data": data.digest, "rule": split.rule, "train": split.train, "test": split.test}
    write_atomic(file, json_bytes(facts))
    return file


def read_split(data: DataSet, name: str = "paper") -> Split:
    """Read a split; trials that are missing in `data` are removed.

    Raises:
        InputError: there is none, it belongs to another data set, is damaged, or has unknown or repeated trials.
    """
    file = _file(data, name)
    try:
        facts = read_json(file)
    except FileNotFoundError:
        known = sorted(other.stem for other in file.parent.glob("*.json"))
        others = f"; it has {listed(known)}" if known else ""
        raise InputError(f"{data.path} has no split {name!r}{others}; cutgrammar split makes one") from None
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(f"split {file} is damaged ({error}); make it again with cutgrammar split") from None
    found = facts.get("schema") if isinstance(facts, dict) else None
    if type(found) is not int or found != SCHEMA:
        raise InputError(
            f"split {file} has schema {shortened(found)}, not {SCHEMA}; make it again with cutgrammar split"
        )
    try:
        check(SPLIT, facts)
    except ValueError as error:
        raise InputError(f"split {file} is damaged: {error}; make it again with cutgrammar split") from None
    if facts["data"] != data.digest:
        raise InputError(f"split {file} was made for another data set; make it again with cutgrammar split")
    train, test = tuple(facts["train"]), tuple(facts["test"])
    missing = set(data.missing)
    whole = Split(name, facts["rule"], train, test)
    _check_trials(whole, {trial.trial for trial in data.trials} | missing, str(file))
    kept = [tuple(trial for trial in trials if trial not in missing) for trials in (train, test)]
    return Split(name, whole.rule, *kept)


def _select(trials: Sequence[TrialSummary], share: float) -> set[int]:
    """Select a share of trials, the same from each set of categories, by lowest hash; at least one in total."""
    strata: dict[str, list[TrialSummary]] = defaultdict(list)
    for trial in trials:
        strata["+".join(trial.categories)].append(trial)
    if not strata:
        return set()
    total = max(1, round(share * len(trials)))
    counts = apportion(total, {name: len(strata[name]) for name in sorted(strata)})
    return {trial.trial for name, count in counts.items() for trial in sorted(strata[name], key=_hash)[:count]}


def _hash(trial: TrialSummary) -> str:
    """A hash of the stable properties of a trial."""
    facts = (trial.seed, trial.demonstrator, trial.trial, trial.setup, trial.foods, trial.categories)
    return hashlib.sha256(repr(facts).encode()).hexdigest()


def _file(data: DataSet, name: str) -> Path:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", name):
        raise InputError(f"split name {name!r} is not a valid file name; use letters, digits, '-', '_' and '.'")
    return data.path / "splits" / f"{name}.json"


def _check_trials(split: Split, known: Iterable[int], where: str) -> None:
    """Check that a split has known trials only, each once.

    Raises:
        InputError: it does not.
    """
    unknown = sorted({*split.train, *split.test} - set(known))
    if unknown:
        raise InputError(f"{where} has trial {unknown[0]}, which is not in the data set; make the split again")
    both = sorted(set(split.train) & set(split.test))
    if both:
        raise InputError(f"{where}: trial {both[0]} is both a training and a test trial; make the split again")
    for trials in (split.train, split.test):
        if len(set(trials)) < len(trials):
            raise InputError(f"{where} has a trial twice; make the split again")


def _checked(split: Split, data: DataSet) -> Split:
    _check_trials(split, [trial.trial for trial in data.trials], f"split {split.name!r}")
    if not split.train:
        raise InputError(
            f"rule {split.rule!r} leaves no training trial of {data.path}; collect N1M1 too, or more trials"
        )
    if not split.test:
        raise InputError(f"rule {split.rule!r} leaves no test trial of {data.path}; collect more trials")
    return split
