"""Which renderer makes the depth images: SAPIEN's where there is a Vulkan device, else one that casts rays.

Both give the same images but for the outermost pixels of a fragment, so their sights differ about as much as those of
two looks. Whoever wants the same sights on every machine names the renderer.
"""

import sys
from collections.abc import Sequence
from functools import lru_cache
from typing import Protocol

from cutgrammar.errors import InputError, one_of
from cutgrammar.geometry.camera import Camera
from cutgrammar.geometry.fragment import Configuration, Mesh
from cutgrammar_sim.cameras.camera import Image
from cutgrammar_sim.cameras.rays import Rays
from cutgrammar_sim.cameras.vulkan import HOW_TO_INSTALL, NoVulkanError, Vulkan


class Renderer(Protocol):
    """Makes depth images."""

    @property
    def name(self) -> str:
        """What the settings call it: "vulkan" or "rays"."""
        ...

    def images(self, cameras: Sequence[Camera], now: Configuration, others: Sequence[Mesh] = ()) -> list[Image]:
        """What each camera images of the board, the fragments and `others`, whose frame is W."""
        ...


@lru_cache(maxsize=3)
def renderer(name: str) -> Renderer:
    """The renderer that the settings call `name`: "vulkan", "rays" or "auto", whose choice is told on stderr once.

    Raises:
        InputError: another name, or Vulkan was asked for by name and there is no device.
    """
    one_of("renderer", name, ["auto", "vulkan", "rays"])
    if name == "rays":
        return Rays()
    try:
        vulkan = Vulkan()
    except NoVulkanError as error:
        if name == "vulkan":
            raise InputError(f"renderer 'vulkan' cannot be used: {error}; {HOW_TO_INSTALL}") from None
        print("cameras: no Vulkan device here, so depth images are made by casting rays", file=sys.stderr)
        return Rays()
    if name == "auto":
        print("cameras: depth images are rendered with Vulkan", file=sys.stderr)
    return vulkan


def render_backend(name: str) -> str:
    """What `renderer(name)` is here, for the record: "vulkan" or "rays"."""
    return renderer(name).name
