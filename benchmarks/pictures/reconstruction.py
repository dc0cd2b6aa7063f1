"""Draws fragments beside their reconstructions from shape features."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar_dashboards.figures.layout.sheet import LYING, PORTRAIT, QUIET_INK, new_sheet
from cutgrammar_dashboards.rendering.body import body_of_fragment
from cutgrammar_dashboards.rendering.palette import FIRST, UNTYPED

SIDE, LEFT, TOP = 1.15, 1.5, 0.55
"""Width of one picture, width of the rows' names, height of the title [inches]."""
ROW = 1.4
"""Height of a row [inches]."""
SCALE = 0.46
"""Inches for the scale of a fragment, its largest half extent: all are drawn with the same length."""


@dataclass(frozen=True, eq=False)
class Pair:
    """A fragment and its reconstruction.

    Attributes:
        fragment: in its canonical frame, divided by its scale.
        reconstructed: in the same frame; None if the decoder classifies no point as inside.
        iou: of the two.
        note: text under the pair.
    """

    fragment: Mesh
    reconstructed: Mesh | None
    iou: float
    note: str = ""


def reconstruction_sheet(groups: Mapping[str, Sequence[Pair]], title: str) -> Figure:
    """One row for each group, its pairs side by side: the fragment left, its reconstruction from z_shape right.

    Raises:
        ValueError: no pairs.
    """
    widest = max((len(pairs) for pairs in groups.values()), default=0)
    if not widest:
        raise ValueError("there are no fragments to show")
    with new_sheet(LEFT + 2.0 * SIDE * widest + 0.1, TOP + ROW * len(groups) + 0.1) as sheet:
        sheet.write(0.15, 0.28, title, fontsize=10.0)
        for row, (name, pairs) in enumerate(groups.items()):
            middle = TOP + ROW * (row + 0.42)
            sheet.write(0.15, middle, name, fontsize=9.0)
            for column, pair in enumerate(pairs):
                left = LEFT + 2.0 * SIDE * column
                for mesh, colour, x in ((pair.fragment, UNTYPED, 0.5), (pair.reconstructed, FIRST[4], 1.5)):
                    if mesh is not None:
                        body = body_of_fragment(Fragment(mesh, LYING), colour)
                        sheet.place([body], PORTRAIT, (left + x * SIDE, middle), SCALE)
                text = f"IoU {pair.iou:.2f}" + (f"  {pair.note}" if pair.note else "")
                sheet.write(left + SIDE, middle + 0.63, text, ha="center", color=QUIET_INK, fontsize=8.0)
    return sheet.figure
