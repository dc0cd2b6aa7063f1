"""A sheet to draw on, measured in inches from its upper left corner: text, lines, charts and drawings of bodies.

Sheets become PNG or SVG files. In an SVG, lines stay lines and text becomes outlines, so that it looks the same
everywhere; drawings of bodies stay pixels. The same sheet gives the same bytes.
"""

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from cutgrammar.atomic_files import write_atomic
from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Cloud, Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar_dashboards.rendering.body import Body, body_of_fragment
from cutgrammar_dashboards.rendering.drawing import Eye, draw, eye_towards
from cutgrammar_dashboards.rendering.palette import Colour

DPI = 200
"""Pixels an inch of drawings of bodies and of PNG files."""
MARGIN = 0.35
"""Of a sheet [inches]."""
INK, QUIET_INK, FAINT, PAPER = "#1b1f24", "#6a737d", "#d8dee4", "#ffffff"
SUFFIXES = (".svg", ".png")
CELLS = "cells"
"""The gid of an image whose cells keep their sharp edges."""
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
"""The eye that sees portraits."""
LYING = Pose(np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]), np.zeros(3))
"""Lays the longest axis (z) of a canonical frame to the right, and its shortest (x) upright."""


@contextmanager
def sheet(width: float, height: float, title: str = "", subtitle: str = "") -> Iterator[tuple[Figure, Axes]]:
    """An empty sheet of this size [inches], in the style of all sheets: x to the right, y downwards."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width, height), facecolor=PAPER)
        ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        ax.set_axis_off()
        ax.set_xlim(0.0, width)
        ax.set_ylim(height, 0.0)
        write(ax, MARGIN, 0.36, title, fontsize=13, fontweight="bold")
        write(ax, MARGIN, 0.62, subtitle, color=QUIET_INK)
        yield figure, ax


def add_chart(figure: Figure, x: float, y: float, width: float, height: float) -> Axes:
    """Axes for a chart whose frame has its upper left corner at (x, y) of a sheet [inches]."""
    sheet_width, sheet_height = figure.get_size_inches()
    return figure.add_axes(
        (x / sheet_width, 1.0 - (y + height) / sheet_height, width / sheet_width, height / sheet_height)
    )


def write_sheet(figure: Figure, path: Path) -> None:
    """Write a sheet to `path`, whole or not at all.

    Raises:
        InputError: the suffix is not in `SUFFIXES`.
    """
    check_picture_name(path)
    content = sheet_bytes(figure, path.suffix.lower().removeprefix("."))
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, content)


def sheet_bytes(figure: Figure, kind: str) -> bytes:
    """A sheet as the content of a file of this kind, "svg" or "png"."""
    for ax in figure.axes:
        for image in ax.images:  # an SVG holds the pixels as they are, a PNG averages them
            if image.get_gid() != CELLS:
                image.set_interpolation("none" if kind == "svg" else "hanning")
    metadata = {"Date": None, "Creator": None} if kind == "svg" else {"Software": None}
    buffer = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(buffer, format=kind, dpi=DPI, facecolor=PAPER, metadata=metadata)
    return buffer.getvalue()


def check_picture_name(path: Path) -> None:
    """Check that a picture can be written to a file of this name.

    Raises:
        InputError: it cannot.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"--out {path} is not the name of a picture; use one that ends in {' or '.join(SUFFIXES)}")


def write(ax: Axes, x: float, y: float, text: str, **style: Any) -> None:
    """Write `text` at (x, y), by default left-aligned and vertically centred."""
    if text:
        ax.text(x, y, text, **{"ha": "left", "va": "center", "zorder": 5, **style})


def draw_line(ax: Axes, points: Sequence[tuple[float, float]], **style: Any) -> None:
    """Draw a line through `points`."""
    x, y = zip(*points, strict=True)
    ax.plot(x, y, **{"color": QUIET_INK, "linewidth": 0.8, "solid_capstyle": "round", **style})


def draw_tile(ax: Axes, x: float, y: float, width: float, height: float) -> None:
    """Draw an empty tile with its upper left corner at (x, y)."""
    frame = FancyBboxPatch((x, y), width, height, boxstyle="round,pad=0,rounding_size=0.06", linewidth=0.8)
    frame.set(facecolor="#fafbfc", edgecolor=FAINT)
    ax.add_patch(frame)


def draw_arrow(ax: Axes, x: float, end: float, y: float) -> None:
    """Draw an arrow to the right from `x` to `end`."""
    ax.annotate("", (end, y), (x, y), arrowprops={"arrowstyle": "->", "color": INK}, zorder=5)


def place(
    ax: Axes, bodies: Sequence[Body], eye: Eye, middle: tuple[float, float], scale: float, zorder: float = 3.0
) -> Callable[[Floats], Floats]:
    """Draw bodies with the middle of their drawing at `middle`.

    Args:
        ax: of a sheet.
        bodies: in the world frame.
        eye: that sees them.
        middle: x, y on the sheet.
        scale: inches a metre.
        zorder: drawing order.

    Returns:
        A function from points (n, 3) [m] to where they are on the sheet (n, 2).
    """
    drawing = draw(bodies, eye, scale * DPI)
    width, height = drawing.size[0] * scale, drawing.size[1] * scale
    left, top = middle[0] - width / 2.0, middle[1] - height / 2.0
    show_pixels(ax, drawing.pixels, (left, left + width, top + height, top), zorder=zorder)
    return lambda p_W: np.asarray(drawing.locate(p_W) * [width, height] + [left, top])


def place_fitted(
    ax: Axes,
    bodies: Sequence[Body],
    eye: Eye,
    middle: tuple[float, float],
    width: float,
    height: float,
    zorder: float = 3.0,
) -> None:
    """Draw bodies as `place` does, at the greatest scale at which they fit into `width` x `height` inches."""
    place(ax, bodies, eye, middle, scale_to_fit(bodies, eye, width, height), zorder)


def show_pixels(ax: Axes, pixels: Any, box: tuple[float, float, float, float], **style: Any) -> None:
    """Show an image between left, right, bottom and top of a sheet, whose limits it leaves alone."""
    limits = ax.get_xlim(), ax.get_ylim()
    ax.imshow(pixels, extent=box, aspect="auto", **style)
    ax.set(xlim=limits[0], ylim=limits[1])


def portrait(shape: Mesh | Cloud, colour: Colour, flip: Pose | None = None) -> Body:
    """A fragment by itself, its longest axis to the right; `flip` is one of `FLIPS`, applied first."""
    X_PC = LYING if flip is None else LYING @ flip
    return body_of_fragment(Fragment(shape, X_PC @ canonical_frame(shape).inverse()), colour)


def seen_size(bodies: Sequence[Body], eye: Eye) -> tuple[float, float]:
    """Width and height of bodies as the eye sees them [m]."""
    seen = np.concatenate([body.vertices for body in bodies]) @ eye.axes.T
    width, height = np.ptp(seen, axis=0)
    return float(width), float(height)


def scale_to_fit(bodies: Sequence[Body], eye: Eye, width: float, height: float) -> float:
    """The greatest scale [inches a metre] at which the drawing of bodies fits into `width` x `height` inches."""
    seen_width, seen_height = seen_size(bodies, eye)
    return min(width / max(seen_width, 1e-9), height / max(seen_height, 1e-9))


def rgb(colour: Colour, brightness: float = 1.0) -> tuple[float, float, float]:
    """A colour as matplotlib takes it."""
    r, g, b = (brightness * part / 255.0 for part in colour)
    return r, g, b
