"""Charts as inline SVG whose lines and letters take the colour of the page around them."""

import html
import io
import re
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from cutgrammar_dashboards.rendering.palette import Colour

INK = "#0a0b0c"
"""Placeholder for the colour of the page's text, which replaces it in the SVG."""

STYLE: dict[str, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "cutgrammar",
    "text.parse_math": False,
    "font.family": "sans-serif",
    "font.size": 10.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    **dict.fromkeys(("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"), INK),
    **dict.fromkeys(("figure.facecolor", "axes.facecolor", "savefig.facecolor", "legend.facecolor"), "none"),
    "legend.frameon": False,
}


def as_svg(figure: Figure, label: str, salt: str) -> str:
    """The figure as an inline SVG whose ids are unique on its page.

    Args:
        figure: made under `STYLE`; everything drawn in `INK` takes the colour of the page's text.
        label: a description for screen readers.
        salt: prefix of its ids, different for every figure of a page.
    """
    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": salt}):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :].replace(INK, "currentColor")
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'(id="|href="#|url\(#)', rf"\g<1>{salt}-", text)
    return text.replace("<svg", f'<svg role="img" aria-label="{html.escape(label)}"', 1)


def hex_of(colour: Colour) -> str:
    """E.g. "#0072b2"."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
