"""A sheet to draw on, measured in inches from its upper left corner: text, lines, charts and drawings of bodies.

Sheets become PNG or SVG files. In an SVG, lines stay lines and text becomes outlines, so that it looks the same
everywhere; drawings of bodies stay pixels. The same sheet gives the same bytes.
"""

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
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


@dataclass(frozen=True, eq=False)
class Sheet:
    """A sheet: x to the right, y downwards from its upper left corner [inches].

    Attributes:
        figure: of the whole.
        ax: covers all of it.
    """

    figure: Figure
    ax: Axes

    def write(self, x: float, y: float, text: str, **style: Any) -> None:
        """Write `text` at (x, y), by default left-aligned and vertically centred."""
        if text:
            self.ax.text(x, y, text, **{"ha": "left", "va": "center", "zorder": 5, **style})

    def line(self, points: Sequence[tuple[float, float]], **style: Any) -> None:
        """Draw a line through `points`."""
        x, y = zip(*points, strict=True)
        self.ax.plot(x, y, **{"color": QUIET_INK, "linewidth": 0.8, "solid_capstyle": "round", **style})

    def tile(self, x: float, y: float, width: float, height: float) -> None:
        """Draw an empty tile with its upper left corner at (x, y)."""
        frame = FancyBboxPatch((x, y), width, height, boxstyle="round,pad=0,rounding_size=0.06", linewidth=0.8)
        frame.set(facecolor="#fafbfc", edgecolor=FAINT)
        self.ax.add_patch(frame)

    def arrow(self, x: float, end: float, y: float) -> None:
        """Draw an arrow to the right from `x` to `end`."""
        self.ax.annotate("", (end, y), (x, y), arrowprops={"arrowstyle": "->", "color": INK}, zorder=5)

    def pixels(self, pixels: Any, box: tuple[float, float, float, float], **style: Any) -> None:
        """Show an image whose left, right, bottom and top are in `box`."""
        limits = self.ax.get_xlim(), self.ax.get_ylim()
        self.ax.imshow(pixels, extent=box, aspect="auto", **style)
        self.ax.set(xlim=limits[0], ylim=limits[1])

    def chart(self, x: float, y: float, width: float, height: float) -> Axes:
        """Axes for a chart whose frame has its upper left corner at (x, y)."""
        sheet_width, sheet_height = self.figure.get_size_inches()
        return self.figure.add_axes(
            (x / sheet_width, 1.0 - (y + height) / sheet_height, width / sheet_width, height / sheet_height)
        )

    def place(
        self, bodies: Sequence[Body], eye: Eye, middle: tuple[float, float], scale: float, zorder: float = 3.0
    ) -> Callable[[Floats], Floats]:
        """Draw bodies with the middle of their drawing at `middle`.

        Args:
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
        self.pixels(drawing.pixels, (left, left + width, top + height, top), zorder=zorder)
        return lambda p_W: np.asarray(drawing.locate(p_W) * [width, height] + [left, top])

    def place_fitted(
        self,
        bodies: Sequence[Body],
        eye: Eye,
        middle: tuple[float, float],
        width: float,
        height: float,
        zorder: float = 3.0,
    ) -> None:
        """Draw bodies as `place` does, at the greatest scale at which they fit into `width` x `height`."""
        self.place(bodies, eye, middle, scale_to_fit(bodies, eye, width, height), zorder)


@contextmanager
def new_sheet(width: float, height: float, title: str = "", subtitle: str = "") -> Iterator[Sheet]:
    """A sheet of this size [inches], within whose context everything is drawn in the style of all sheets."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width, height), facecolor=PAPER)
        ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        ax.set_axis_off()
        ax.set(xlim=(0.0, width), ylim=(height, 0.0))
        sheet = Sheet(figure, ax)
        sheet.write(MARGIN, 0.36, title, fontsize=13, fontweight="bold")
        sheet.write(MARGIN, 0.62, subtitle, color=QUIET_INK)
        yield sheet


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
