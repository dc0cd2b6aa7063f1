"""Methods, worlds, foods and scores of installed packages, found by name through entry points.

The driver resolves a name to "module:attribute" and sends that, because remote workers have the code of a package but
not its metadata.
"""

from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

from cutgrammar.errors import InputError, one_of

METHODS, WORLDS, FOODS = "cutgrammar.methods", "cutgrammar.worlds", "cutgrammar.foods"
SCORES = "cutgrammar.scores"


def names_in(group: str) -> list[str]:
    """The names that installed packages register in an entry-point group, sorted."""
    return list(references_in(group))


def references_in(group: str) -> dict[str, str]:
    """Name -> "module:attribute" of everything that installed packages register in an entry-point group, by name."""
    return dict(sorted((point.name, point.value) for point in entry_points(group=group)))


def reference_of(group: str, name: str) -> str:
    """The "module:attribute" that `name` stands for in an entry-point group.

    Raises:
        InputError: the name is unknown; the message lists the known ones.
    """
    references = references_in(group)
    return references[one_of(group.removeprefix("cutgrammar.").removesuffix("s"), name, list(references))]


def load(reference: str) -> Any:
    """The object that "module:attribute" names.

    Raises:
        InputError: there is no such module or attribute, as where a plugin is not installed on every node.
    """
    module, _, attribute = reference.partition(":")
    try:
        return getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise InputError(f"{reference} cannot be loaded ({error}); install its package on every node") from error
