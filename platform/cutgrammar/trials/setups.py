"""The six task setups of Table I: N initial objects, M fragment categories in the goal."""

from dataclasses import dataclass

from cutgrammar.errors import one_of


@dataclass(frozen=True)
class Setup:
    """N initial objects to be cut into M categories; `share` is its number of trials among the paper's 110 (IV-A)."""

    objects: int
    categories: int
    share: int

    @property
    def name(self) -> str:
        """The name, e.g. "N2M1"."""
        return f"N{self.objects}M{self.categories}"


SETUPS: dict[str, Setup] = {
    setup.name: setup
    for setup in (Setup(1, 1, 40), Setup(1, 2, 14), Setup(2, 1, 14), Setup(2, 2, 14), Setup(2, 3, 14), Setup(3, 4, 14))
}
"""The setups of Table I by name."""


def setup_named(name: str) -> Setup:
    """The setup with this name.

    Raises:
        InputError: unknown name; the message lists the known ones.
    """
    return SETUPS[one_of("setup", name, list(SETUPS))]
