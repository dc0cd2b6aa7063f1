"""Films as files: WebP, GIF or APNG, by the file's suffix.

All three are written by pillow, which matplotlib brings along, and shown by every browser and by the pages of code
hosts. An MP4 would need an encoder of 68 MB.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image as Pillow

from cutgrammar.errors import InputError, one_of
from cutgrammar_sim.cameras.painting import Picture

SUFFIXES = (".webp", ".gif", ".png")
"""A WebP is the smallest by far; a GIF has 256 colours; a PNG loses nothing."""


def write_film(path: Path, frames: Iterable[Picture], rate: float) -> int:
    """Write pictures, `rate` a second, for ever again; returns how many there were.

    Raises:
        InputError: another suffix, no picture, or the file cannot be written.
    """
    one_of("suffix of a film", path.suffix, SUFFIXES)
    pictures = [Pillow.fromarray(frame) for frame in frames]
    if not pictures:
        raise InputError(f"there is nothing to show in {path}")
    count = len(pictures)
    if path.suffix == ".gif":  # one palette, so that what stands still does not flicker
        some = [np.asarray(pictures[i]) for i in np.unique(np.linspace(0, count - 1, 8).astype(int))]
        palette = Pillow.fromarray(np.concatenate(some)).quantize(256, dither=Pillow.Dither.NONE)
        pictures = [picture.quantize(palette=palette, dither=Pillow.Dither.NONE) for picture in pictures]
    how: dict[str, Any] = {".webp": {"quality": 80, "method": 4}, ".gif": {"disposal": 1}, ".png": {}}[path.suffix]
    try:
        pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=1000.0 / rate, loop=0, **how)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error}") from None
    return count
