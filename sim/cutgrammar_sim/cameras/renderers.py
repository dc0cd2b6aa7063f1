"""Which renderer makes the depth images."""

from collections.abc import Sequence
from typing import Protocol

from cutgrammar.geometry.fragment import Configuration, Mesh
from cutgrammar_sim.cameras.camera import Camera, Image
from cutgrammar_sim.cameras.rays import Rays


class Renderer(Protocol):
    """Makes depth images.

    Attributes:
        name: of the renderer, for the record.
    """

    name: str

    def images(self, cameras: Sequence[Camera], now: Configuration, others: Sequence[Mesh] = ()) -> list[Image]:
        """What each camera images of the board, the fragments and `others`, whose frame is W."""
        ...


def renderer(name: str) -> Renderer:
    """The renderer that the settings call `name`."""
    del name
    return Rays()
