"""The variants and transfers of a study: the tables `[[variants]]` and `[[transfers]]` of its file.

A variant is the study with some settings, the training seed or the number of training trials changed; its test trials
stay the same. A transfer trains on some foods and tests on others.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from pydantic.dataclasses import dataclass as checked

from cutgrammar.errors import InputError
from cutgrammar.settings import Settings, from_tables, validated
from cutgrammar.untrusted import shortened
from cutgrammar_pipelines.config.options import (
    CHECKED,
    Count,
    GoalCondition,
    Maximum,
    MethodName,
    Natural,
    SetupName,
    Some,
)
from cutgrammar_pipelines.tracking.run_log import flat

TABLES = ("variants", "transfers")
"""Names of these tables."""
MOST = 1_000
"""Most variants of a study, and most transfers."""
METHODS = ("grammar",)
T = TypeVar("T", "Variation", "Transfer")


@checked(frozen=True, config=CHECKED)
class Variation:
    """A table `[[variants]]` without its settings.

    Attributes:
        name: of its folders; letters, digits, '-', '_' and '.'.
        question: the question it answers, in a few words; tables group variants by question.
        methods: the methods evaluated.
        seed_offset: added to the study's seed in training.
        train_trials: number of training trials; 0 for those of the split.
    """

    name: str = ""
    question: str = ""
    methods: Some[MethodName] = METHODS
    seed_offset: Natural = 0
    train_trials: Maximum = 0


@dataclass(frozen=True)
class Variant:
    """A variant of a study.

    Attributes:
        options: its name, methods and training.
        changes: its own settings, by dotted name.
        settings: all of them.
    """

    options: Variation
    changes: Mapping[str, Any]
    settings: Settings


@checked(frozen=True, config=CHECKED)
class Transfer:
    """A table `[[transfers]]`: a model of some foods, tested on these and on others.

    Attributes:
        name: of its folders; letters, digits, '-', '_' and '.'.
        train_foods: foods to train on; their other trials are tested too.
        test_foods: foods that are only tested.
        setups: of all demonstrations; they must include N1M1, from which models learn.
        trials: number of demonstrations with the former foods, and with the latter.
        test_trials: maximum number of test trials of each setup; 0 for all.
        methods: the methods evaluated.
        goals: the goal conditions; those of the study if there are none. With foreign-food, what one food was cut into
            is the goal of the other.
    """

    name: str = ""
    train_foods: Some[str] = ("carrot",)
    test_foods: Some[str] = ("potato",)
    setups: Some[SetupName] = ("N1M1",)
    trials: Count = 40
    test_trials: Maximum = 0
    methods: Some[MethodName] = METHODS
    goals: tuple[GoalCondition, ...] = ()


@dataclass(frozen=True)
class Variations:
    """All variants and transfers of a study."""

    variants: tuple[Variant, ...] = ()
    transfers: tuple[Transfer, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.variants or self.transfers)


def read_variations(tables: dict[str, Any], source: str) -> Variations:
    """Take the variants and transfers out of a study's tables; the other tables stay, as the settings of its steps.

    Args:
        tables: of the study's file, without those of its steps.
        source: name of the file in error messages.

    Raises:
        InputError: a name is unknown, missing, given twice or unfit for a folder, or a value is of another type or out
            of bounds.
    """
    lists = {name: _list(tables.pop(name, []), f"{source}: {name}") for name in TABLES}
    from_tables(tables, source)  # what variants start from
    variants = tuple(
        _variant(table, tables, f"{source}: variant {number}")
        for number, table in enumerate(lists["variants"], start=1)
    )
    transfers = tuple(
        _named(validated(Transfer, table, f"{source}: transfer {number}"), f"{source}: transfer {number}")
        for number, table in enumerate(lists["transfers"], start=1)
    )
    names = [variant.options.name for variant in variants] + [transfer.name for transfer in transfers]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{source}: two variants or transfers are called {name!r}; give each name once")
    for transfer in transfers:
        if both := set(transfer.train_foods) & set(transfer.test_foods):
            raise InputError(
                f"{source}: transfer {transfer.name!r} trains on {min(both)!r} and tests it as another food"
            )
    return Variations(variants, transfers)


def _variant(table: Any, base: Mapping[str, Any], source: str) -> Variant:
    if not isinstance(table, dict):
        raise InputError(f"{source} must be a table, not {shortened(table)}")
    own = {name: value for name, value in table.items() if name != "settings"}
    options = _named(validated(Variation, own, source), source)
    changes = table.get("settings", {})
    from_tables(
        changes, f"{source} ({options.name}), settings"
    )  # checked alone first, so that errors name the variant's own settings
    merged = {name: {**base.get(name, {}), **changes.get(name, {})} for name in (*base, *changes)}
    return Variant(options, flat(changes), from_tables(merged, f"{source} ({options.name})"))


def _named(thing: T, source: str) -> T:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", thing.name):
        raise InputError(
            f"{source}: name {shortened(thing.name)} cannot be a folder's; use letters, digits, '-', '_' and '.'"
        )
    return thing


def _list(value: Any, source: str) -> list[Any]:
    if isinstance(value, list) and len(value) > MOST:
        raise InputError(f"{source} are {len(value)}; at most {MOST} are possible")
    if not isinstance(value, list):
        raise InputError(f"{source} must be tables in double brackets, e.g. [[variants]], not {shortened(value)}")
    return value
