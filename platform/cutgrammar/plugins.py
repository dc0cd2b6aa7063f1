"""Methods, worlds and foods are found by name through entry points.

The driver resolves a name to "module:attribute" and sends that: remote workers have the code but no package metadata.
"""

from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

from cutgrammar.errors import InputError, one_of

METHODS, WORLDS, FOODS = "cutgrammar.methods", "cutgrammar.worlds", "cutgrammar.foods"


def names_in(group: str) -> list[str]:
    """The names that installed packages register in an entry-point group, sorted."""
    return sorted({point.name for point in entry_points(group=group)})


def reference_of(group: str, name: str) -> str:
    """The "module:attribute" that `name` stands for in an entry-point group.

    Raises:
        InputError: no such name; the message names those there are.
    """
    one_of(group.removeprefix("cutgrammar.").removesuffix("s"), name, names_in(group))
    return next(point.value for point in entry_points(group=group) if point.name == name)


def load(reference: str) -> Any:
    """The object that "module:attribute" names.

    Raises:
        InputError: no such module or attribute; a user's plugin must be installed on every node.
    """
    module, _, attribute = reference.partition(":")
    try:
        return getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise InputError(f"{reference} cannot be loaded ({error}); install its package on every node") from error
