"""Chooses the renderer of depth images: SAPIEN's if there is a Vulkan device, otherwise ray casting.

Their images differ only in the outermost pixels of a fragment, so their clouds differ about as much as those of two
looks. To get the same clouds on every machine, name the renderer.
"""

import logging
from collections.abc import Sequence
from functools import lru_cache
from typing import Protocol

from cutgrammar.errors import InputError, one_of
from cutgrammar.geometry.camera import Camera
from cutgrammar.geometry.fragment import Configuration, Mesh
from cutgrammar_sim.cameras.camera import Image
from cutgrammar_sim.cameras.rays import Rays
from cutgrammar_sim.cameras.vulkan import HOW_TO_INSTALL, NoVulkanError, Vulkan

LOG = logging.getLogger(__name__)


class Renderer(Protocol):
    """Renders depth images."""

    @property
    def name(self) -> str:
        """Its name in the settings: "vulkan" or "rays"."""
        ...

    def images(self, cameras: Sequence[Camera], now: Configuration, others: Sequence[Mesh] = ()) -> list[Image]:
        """The images that the cameras take of the board, the fragments and `others`, whose frame is W."""
        ...


@lru_cache(maxsize=3)
def renderer(name: str) -> Renderer:
    """The renderer called `name`: "vulkan", "rays" or "auto", which prints its choice on stderr once.

    Raises:
        InputError: the name is unknown, or it is "vulkan" and there is no device.
    """
    one_of("renderer", name, ["auto", "vulkan", "rays"])
    if name == "rays":
        return Rays()
    try:
        vulkan = Vulkan()
    except NoVulkanError as error:
        if name == "vulkan":
            raise InputError(f"renderer 'vulkan' cannot be used: {error}; {HOW_TO_INSTALL}") from None
        LOG.warning("cameras: no Vulkan device here, so depth images are made by casting rays")
        return Rays()
    if name == "auto":
        LOG.warning("cameras: depth images are rendered with Vulkan")
    return vulkan
