"""Methods, worlds, foods and scores of installed packages, found by name through entry points.

The driver resolves a name to "module:attribute" and sends that, because remote workers have the code of a package but
not its metadata.
"""

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, Protocol, TypeVar

from cutgrammar.errors import InputError, one_of

METHODS, WORLDS, FOODS = "cutgrammar.methods", "cutgrammar.worlds", "cutgrammar.foods"
SCORES = "cutgrammar.scores"


def names_in(group: str) -> list[str]:
    """The names that installed packages register in an entry-point group, sorted."""
    return list(references_in(group))


def references_in(group: str) -> dict[str, str]:
    """Name -> "module:attribute" of everything that installed packages register in an entry-point group, by name."""
    return {name: points[0].value for name, points in _registered(group).items()}


def _registered(group: str) -> dict[str, list[EntryPoint]]:
    """Name -> the entry points that packages register under it, by name."""
    found: dict[str, list[EntryPoint]] = {}
    for point in sorted(
        _entry_points(tuple(sys.path)).select(group=group), key=lambda point: (point.name, point.value)
    ):
        found.setdefault(point.name, []).append(point)
    return found


def _package(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist is not None else "a package without metadata"


@cache
def _entry_points(_: tuple[str, ...]) -> Any:
    """All entry points of the packages on a search path; reading the metadata of some hundred packages takes 20 ms."""
    return entry_points()


def reference_of(group: str, name: str) -> str:
    """The "module:attribute" that `name` stands for in an entry-point group.

    Raises:
        InputError: the name is unknown; the message lists the known ones. Or two packages register it for different
            things.
    """
    points = _registered(group)
    found = points[one_of(_kind(group), name, list(points))]
    if len({point.value for point in found}) > 1:
        both = " and ".join(sorted({f"{_package(point)} ({point.value})" for point in found}))
        raise InputError(f"{_kind(group)} {name!r} is registered by {both}; uninstall one, or rename its entry point")
    return found[0].value


def package_of(group: str, name: str) -> str:
    """Name and version of the package that registers `name` in an entry-point group.

    Raises:
        InputError: as `reference_of`.
    """
    reference_of(group, name)
    return _package(_registered(group)[name][0])


def load(reference: str) -> Any:
    """The object that "module:attribute" names.

    Raises:
        InputError: there is no such module or attribute, as where a plugin is not installed on every node.
    """
    module, _, attribute = reference.partition(":")
    try:
        return getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise InputError(
            f"{reference} cannot be loaded ({error}); install its package on every node, or send it with --py-module"
        ) from error


class Entry(Protocol):
    """What an entry point of a `Registry` yields."""

    @property
    def name(self) -> str:
        """The name of its entry point."""

    @property
    def table_order(self) -> Any:
        """The key that sorts entries in tables."""


T = TypeVar("T", bound=Entry)


@dataclass(frozen=True)
class Registry(Generic[T]):
    """The entries of one type that installed packages register in an entry-point group.

    Attributes:
        group: the entry-point group.
        type: type of the entries.
        unknown: makes the entry that stands for one that cannot be loaded, from its name and the reason.
    """

    group: str
    type: type[T]
    unknown: Callable[[str, str], T]

    def load(self, reference: str) -> T:
        """The entry that "module:attribute" names.

        Raises:
            InputError: it cannot be loaded or has another type.
        """
        entry, name = load(reference), self.type.__name__
        if not isinstance(entry, self.type):
            raise InputError(
                f"{reference} is a {type(entry).__name__}; an entry point of {self.group} must be a {name}"
            )
        return entry

    def find(self, name: str) -> T:
        """The installed entry called `name`.

        Raises:
            InputError: no installed package provides it, it cannot be loaded, or it has another type or name.
        """
        reference = reference_of(self.group, name)
        entry = self.load(reference)
        if entry.name != name:
            raise InputError(f"{reference} is called {entry.name!r}, its entry point {name!r}; give both the same name")
        return entry

    def describe(self, names: Iterable[str]) -> tuple[T, ...]:
        """The entries called `names`, in the order of tables; `unknown` stands for each that cannot be loaded."""
        return tuple(sorted(map(self._described, dict.fromkeys(names)), key=lambda entry: entry.table_order))

    def _described(self, name: str) -> T:
        if name not in names_in(self.group):
            return self.unknown(name, f"{_kind(self.group)} {name!r} is not installed")
        try:
            return self.find(name)
        except InputError as error:
            return self.unknown(name, str(error))


def _kind(group: str) -> str:
    return group.removeprefix("cutgrammar.").removesuffix("s")
