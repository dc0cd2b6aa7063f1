"""The methods that installed packages provide, as entry points of the group "cutgrammar.methods"."""

from cutgrammar.errors import InputError
from cutgrammar.interfaces import Planner
from cutgrammar.methods.method import Method, PlanningContext
from cutgrammar.plugins import METHODS, Registry, names_in


def installed_methods() -> tuple[Method, ...]:
    """All installed methods, in the order of tables; one that cannot be loaded is of kind "unknown"."""
    return describe_methods(names_in(METHODS))


def find_method(name: str) -> Method:
    """The installed method called `name`.

    Raises:
        InputError: no installed package provides it, it cannot be loaded, or it is no `Method` of that name.
    """
    return _REGISTRY.find(name)


def _unknown(name: str, reason: str) -> Method:
    """No competitor, since it cannot be known whether the method sees the demonstration."""

    def refuse(_: PlanningContext) -> Planner:
        raise InputError(reason)

    return Method(name, refuse, description=reason, kind="unknown")


_REGISTRY = Registry(METHODS, Method, _unknown)
load_method, describe_methods = _REGISTRY.load, _REGISTRY.describe
