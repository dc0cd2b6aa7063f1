"""Films as files: WebP, GIF or APNG, by the file's suffix.

Pillow writes all three; every browser and every code host shows them. An MP4 would need an encoder of 68 MB.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from cutgrammar.errors import InputError, one_of
from cutgrammar_dashboards.rendering.scene import Pixels

SUFFIXES = (".webp", ".gif", ".png")
"""A WebP is the smallest by far; a GIF has 256 colours; a PNG is lossless."""


def write_film(path: Path, frames: Iterable[Pixels], rate: float) -> None:
    """Write a film that repeats for ever, `rate` frames a second.

    Raises:
        InputError: another suffix, no frames, or the file cannot be written.
    """
    one_of("suffix of a film", path.suffix, SUFFIXES)
    pictures = [Image.fromarray(frame) for frame in frames]
    if not pictures:
        raise InputError(f"there is nothing to show in {path}")
    if path.suffix == ".gif":  # one palette for all, so that still parts do not flicker
        samples = [np.asarray(pictures[i]) for i in np.unique(np.linspace(0, len(pictures) - 1, 8).astype(int))]
        palette = Image.fromarray(np.concatenate(samples)).quantize(256, dither=Image.Dither.NONE)
        pictures = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    options: dict[str, Any] = {".webp": {"quality": 80, "method": 4}, ".gif": {"disposal": 1}, ".png": {}}[path.suffix]
    try:
        pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=1000.0 / rate, loop=0, **options)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error}") from None
