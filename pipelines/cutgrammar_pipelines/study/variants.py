"""What a study varies beside its main evaluation: the tables `[[variants]]` and `[[transfers]]` of its settings file.

A variant is the study with some settings, the training seed or the number of training trials changed; its test trials
stay the same. A transfer trains on some foods and tests on others.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pydantic.dataclasses import dataclass as checked

from cutgrammar.errors import InputError
from cutgrammar.settings import Settings, from_tables, read_tables, validated
from cutgrammar.settings.bounds import CHECKED, Count, Names, Natural, Text
from cutgrammar_pipelines.tracking.logs import flat

TABLES = ("variants", "transfers")
"""The tables of a study's file that are read here."""
METHODS = ("grammar",)
T = TypeVar("T", "Variation", "Transfer")


@checked(frozen=True, config=CHECKED)
class Variation:
    """A table `[[variants]]` without its settings.

    Attributes:
        name: of its folders; letters, digits, '-', '_' and '.'.
        question: what it is to answer, in a few words; variants of one question stand together.
        methods: the methods evaluated.
        seed_offset: added to the study's seed in training.
        train_trials: to learn from; 0: those of the split. Fewer are some of these; more are demonstrated anew.
    """

    name: Text = ""
    question: Text = ""
    methods: Names = METHODS
    seed_offset: Natural = 0
    train_trials: Natural = 0


@dataclass(frozen=True)
class Variant:
    """A variant of a study.

    Attributes:
        asked: what it is called, evaluates and is trained on.
        changes: the settings that are its own, by dotted name.
        settings: all of them.
    """

    asked: Variation
    changes: Mapping[str, Any]
    settings: Settings


@checked(frozen=True, config=CHECKED)
class Transfer:
    """A table `[[transfers]]`: the model of some foods, tested on these and on others.

    Attributes:
        name: of its folders; letters, digits, '-', '_' and '.'.
        train_foods: foods to learn from; those of their trials that do not train are tested too.
        test_foods: foods tested only.
        setups: of all demonstrations; N1M1, from which models learn, must be among them.
        trials: demonstrations with the former, and as many with the latter.
        test_trials: at most so many test trials of each setup, 0 for all.
        methods: the methods evaluated.
    """

    name: Text = ""
    train_foods: Names = ("carrot",)
    test_foods: Names = ("potato",)
    setups: Names = ("N1M1",)
    trials: Count = 40
    test_trials: Natural = 0
    methods: Names = METHODS


@dataclass(frozen=True)
class Variations:
    """All variants and transfers of a study."""

    variants: tuple[Variant, ...] = ()
    transfers: tuple[Transfer, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.variants or self.transfers)

    @property
    def methods(self) -> tuple[str, ...]:
        """All methods that they ask for, each once."""
        asked = [v.asked.methods for v in self.variants] + [t.methods for t in self.transfers]
        return tuple(dict.fromkeys(method for methods in asked for method in methods))


def load_variations(file: Path) -> Variations:
    """The variants and transfers in a study's settings file; none where it has no such tables.

    Raises:
        InputError: no such file, not TOML, a name that is unknown, missing, taken or cannot be a file's, or a value of
            another type or out of bounds.
    """
    tables = read_tables(file)
    tables.pop("study", None)
    asked = {name: _list(tables.pop(name, []), f"{file}: {name}") for name in TABLES}
    variants = tuple(
        _variant(table, tables, f"{file}: variant {number}") for number, table in enumerate(asked["variants"], start=1)
    )
    transfers = tuple(
        _named(validated(Transfer, table, f"{file}: transfer {number}"), f"{file}: transfer {number}")
        for number, table in enumerate(asked["transfers"], start=1)
    )
    names = [variant.asked.name for variant in variants] + [transfer.name for transfer in transfers]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{file}: two variants or transfers are called {name!r}; name each once")
    for transfer in transfers:
        if both := set(transfer.train_foods) & set(transfer.test_foods):
            raise InputError(f"{file}: transfer {transfer.name!r} trains on {min(both)!r} and tests it as another food")
    return Variations(variants, transfers)


def _variant(table: Any, base: Mapping[str, Any], source: str) -> Variant:
    if not isinstance(table, dict):
        raise InputError(f"{source} must be a table, not {table!r}")
    own = {name: value for name, value in table.items() if name != "settings"}
    asked = _named(validated(Variation, own, source), source)
    changes = table.get("settings", {})
    from_tables(changes, f"{source} ({asked.name}), settings")  # its own words first, so that an error names them
    merged = {name: {**base.get(name, {}), **changes.get(name, {})} for name in (*base, *changes)}
    return Variant(asked, flat(changes), from_tables(merged, f"{source} ({asked.name})"))


def _named(thing: T, source: str) -> T:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", thing.name):
        raise InputError(f"{source}: name {thing.name!r} cannot be a folder's; use letters, digits, '-', '_' and '.'")
    return thing


def _list(value: Any, source: str) -> list[Any]:
    if not isinstance(value, list):
        raise InputError(f"{source} must be tables in double brackets, e.g. [[variants]], not {value!r}")
    return value
