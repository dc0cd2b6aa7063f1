"""A sheet to draw on, measured in inches from its upper left corner: fragments as pictures, lines, words.

Sheets become PNG or SVG, by the name of the file. In an SVG lines stay lines and words are outlines, so that it looks
the same everywhere; pictures of fragments are pixels within it. The same sheet gives the same bytes.
"""

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cutgrammar.atomic_files import write_atomic
from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Cloud, Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar_dashboards.rendering.body import Body, body_of_fragment
from cutgrammar_dashboards.rendering.drawing import Eye, draw, eye_towards
from cutgrammar_dashboards.rendering.palette import Colour

DOTS = 200
"""Pixels an inch of pictures of fragments and of PNG files."""
INK, QUIET_INK, FAINT, PAPER = "#1b1f24", "#6a737d", "#d8dee4", "#ffffff"
SUFFIXES = (".svg", ".png")
CELLS = "cells"
"""Marks an image whose cells are to keep their edges."""
STYLE: dict[str, Any] = {
    "svg.fonttype": "path",
    "svg.hashsalt": "cutgrammar",
    "text.parse_math": False,
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "text.color": INK,
    "axes.edgecolor": QUIET_INK,
    "axes.labelcolor": INK,
    "xtick.color": QUIET_INK,
    "ytick.color": QUIET_INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
}
PORTRAIT = eye_towards(0.30, -0.80, 0.55)
"""Where portraits are seen from."""
LYING = Pose(np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]), np.zeros(3))
"""Lays the longest axis (z) of a canonical frame to the right, and its shortest (x) upright."""


def sheet(width: float, height: float) -> tuple[Figure, Axes]:
    """An empty sheet: x to the right and y downwards from the upper left corner [inches]."""
    figure = Figure(figsize=(width, height), facecolor=PAPER)
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set_axis_off()
    _bound(ax, width, height)
    return figure, ax


def chart(figure: Figure, x: float, y: float, width: float, height: float) -> Axes:
    """Axes for a chart whose frame has its upper left corner at (x, y) of a sheet [inches]."""
    whole_width, whole_height = figure.get_size_inches()
    return figure.add_axes(
        (x / whole_width, 1.0 - (y + height) / whole_height, width / whole_width, height / whole_height)
    )


def write_sheet(figure: Figure, path: Path) -> None:
    """Write a sheet to `path`, whole or not at all.

    Raises:
        InputError: the name ends in something else than `SUFFIXES`.
    """
    check_picture_name(path)
    content = sheet_bytes(figure, path.suffix.lower().removeprefix("."))
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, content)


def sheet_bytes(figure: Figure, kind: str) -> bytes:
    """A sheet as the content of a file of this kind, "svg" or "png"."""
    for ax in figure.axes:
        for image in ax.images:  # an SVG holds the pixels as they are, a PNG is made of their means
            if image.get_gid() != CELLS:
                image.set_interpolation("none" if kind == "svg" else "hanning")
    metadata = {"Date": None, "Creator": None} if kind == "svg" else {"Software": None}
    buffer = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(buffer, format=kind, dpi=DOTS, facecolor=PAPER, metadata=metadata)
    return buffer.getvalue()


def check_picture_name(path: Path) -> None:
    """Pass if a picture can be written to a file of this name.

    Raises:
        InputError: it cannot.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"--out {path} is no picture's name; end it in {' or '.join(SUFFIXES)}")


def words(ax: Axes, x: float, y: float, text: str, **how: Any) -> None:
    """Write `text` at (x, y), by default begun there and centred in height."""
    style: dict[str, Any] = {"ha": "left", "va": "center", "zorder": 5} | how
    ax.text(x, y, text, **style)


def line(ax: Axes, points: Sequence[tuple[float, float]], **how: Any) -> None:
    """Draw a line through `points`."""
    style: dict[str, Any] = {"color": QUIET_INK, "linewidth": 0.8, "solid_capstyle": "round"} | how
    ax.plot([x for x, _ in points], [y for _, y in points], **style)


def put(
    ax: Axes, bodies: Sequence[Body], eye: Eye, middle: tuple[float, float], scale: float, zorder: float = 3.0
) -> Callable[[Floats], Floats]:
    """Show `bodies` with the middle of their picture at `middle`.

    Args:
        ax: of a sheet.
        bodies: what is shown.
        eye: from where.
        middle: x, y on the sheet.
        scale: inches a metre.
        zorder: what lies over what.

    Returns:
        A function from points (n, 3) [m] to where they are seen on the sheet (n, 2).
    """
    drawing = draw(bodies, eye, scale * DOTS)
    width, height = drawing.size[0] * scale, drawing.size[1] * scale
    left, top = middle[0] - width / 2.0, middle[1] - height / 2.0
    limits = ax.get_xlim(), ax.get_ylim()
    ax.imshow(drawing.pixels, extent=(left, left + width, top + height, top), zorder=zorder, aspect="auto")
    ax.set_xlim(limits[0])
    ax.set_ylim(limits[1])
    return lambda p_W: np.asarray(drawing.locate(p_W) * [width, height] + [left, top])


def portrait(shape: Mesh | Cloud, colour: Colour, flip: Pose | None = None) -> Body:
    """A fragment by itself, lying with its longest axis to the right; `flip` is one of `FLIPS`, applied before."""
    X_FC = canonical_frame(shape)
    X_PC = LYING if flip is None else LYING @ flip
    return body_of_fragment(Fragment(shape, X_PC @ X_FC.inverse()), colour)


def seen_size(bodies: Sequence[Body], eye: Eye) -> tuple[float, float]:
    """Width and height of the picture of `bodies` [m]."""
    seen = np.concatenate([body.vertices for body in bodies]) @ eye.axes.T
    width, height = np.ptp(seen, axis=0)
    return float(width), float(height)


def scale_to_fit(bodies: Sequence[Body], eye: Eye, width: float, height: float) -> float:
    """The greatest scale [inches a metre] at which the picture of `bodies` fits into `width` x `height` inches."""
    wide, high = seen_size(bodies, eye)
    return min(width / max(wide, 1e-9), height / max(high, 1e-9))


def _bound(ax: Axes, width: float, height: float) -> None:
    ax.set_xlim(0.0, width)
    ax.set_ylim(height, 0.0)
