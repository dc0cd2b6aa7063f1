"""The methods that installed packages provide, as entry points of the group "cutgrammar.methods"."""

from collections.abc import Iterable

from cutgrammar.errors import InputError
from cutgrammar.interfaces import Planner
from cutgrammar.methods.method import Method, PlanningContext
from cutgrammar.plugins import METHODS, load, names_in, reference_of


def load_method(reference: str) -> Method:
    """The method that "module:attribute" names.

    Raises:
        InputError: it cannot be loaded or is no `Method`.
    """
    found = load(reference)
    if not isinstance(found, Method):
        raise InputError(f"{reference} is a {type(found).__name__}; an entry point of {METHODS} must be a Method")
    return found


def find_method(name: str) -> Method:
    """The installed method called `name`.

    Raises:
        InputError: no installed package provides it, or its entry point does not yield a `Method` of this name.
    """
    reference = reference_of(METHODS, name)
    found = load_method(reference)
    if found.name != name:
        raise InputError(f"{reference} is called {found.name!r}, its entry point {name!r}; give both the same name")
    return found


def installed_methods() -> tuple[Method, ...]:
    """All installed methods, in the order of tables; one that cannot be loaded is described as such."""
    return describe_methods(names_in(METHODS))


def describe_methods(names: Iterable[str]) -> tuple[Method, ...]:
    """The methods called `names`, in the order of tables.

    A method that is not installed, such as one of an old ledger, is of kind "unknown". It cannot be known whether it
    sees the demonstration, so it is no competitor.
    """
    return tuple(sorted(map(_described, dict.fromkeys(names)), key=lambda method: method.table_order))


def _described(name: str) -> Method:
    if name not in names_in(METHODS):
        return _unknown(name, InputError(f"method {name!r} is not installed"))
    try:
        return find_method(name)
    except InputError as error:
        return _unknown(name, error)


def _unknown(name: str, error: InputError) -> Method:
    def refuse(_: PlanningContext) -> Planner:
        raise InputError(str(error))

    return Method(name, refuse, description=str(error), kind="unknown")
