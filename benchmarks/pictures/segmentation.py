"""Draws fused clouds of fragments coloured by their true fragments and by a segmentation, side by side."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import linear_sum_assignment

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar_dashboards.figures.layout.sheet import QUIET_INK, new_sheet

WIDTH, HEIGHT, TOP, LEFT = 3.6, 2.3, 0.5, 0.15
"""Size of one cloud, height of the title and left margin [inches]."""
EYE = np.array([[1.0, 0.0, 0.0], [0.0, 0.77, 0.64]])
"""Directions in W to the right and up in a picture: the board is seen from the front and above."""
COLOURS = (
    *("#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#e377c2", "#bcbd22", "#17becf", "#aec7e8"),
    *("#ffbb78", "#98df8a", "#ff9896", "#c5b0d5", "#c49c94", "#f7b6d2", "#dbdb8d", "#9edae5", "#393b79", "#637939"),
    *("#8c6d31", "#843c39", "#7b4173", "#3182bd"),
)
NOTHING = "#c8ccd0"
"""Colour of a point that belongs to no fragment."""


@dataclass(frozen=True, eq=False)
class SegmentedCloud:
    """A cloud and its segmentation.

    Attributes:
        points: (n, 3) in W [m].
        owners, labels: (n,) the true fragment and the assigned label of each point; negative for none.
        note: text under it.
    """

    points: Floats
    owners: Ints
    labels: Ints
    note: str


def segmentation_sheet(clouds: Sequence[SegmentedCloud], title: str) -> Figure:
    """One row for each cloud: its true fragments and its segmentation, in matching colours.

    Raises:
        ValueError: no clouds.
    """
    if not clouds:
        raise ValueError("there are no clouds to show")
    with new_sheet(LEFT + 2.0 * WIDTH, TOP + HEIGHT * len(clouds)) as sheet:
        sheet.write(LEFT, 0.2, title, fontsize=9.0)
        for row, cloud in enumerate(clouds):
            seen = cloud.points @ EYE.T
            order = np.argsort(
                cloud.points @ np.array([0.0, -0.64, 0.77]), kind="stable"
            )  # nearer points are drawn last
            lowest, highest = seen.min(axis=0), seen.max(axis=0)
            scale = min((WIDTH - 0.3) / (highest[0] - lowest[0]), (HEIGHT - 0.6) / (highest[1] - lowest[1]))
            at = (seen - (lowest + highest) / 2.0) * [scale, -scale]
            for column, numbers in enumerate((cloud.owners, matching_labels(cloud.owners, cloud.labels))):
                x = LEFT + WIDTH * (column + 0.5)
                y = TOP + HEIGHT * row + (HEIGHT - 0.3) / 2.0
                colours = [COLOURS[i % len(COLOURS)] if i >= 0 else NOTHING for i in numbers[order].tolist()]
                sheet.ax.scatter(x + at[order, 0], y + at[order, 1], s=0.6, c=colours, linewidths=0.0, rasterized=True)
            sheet.write(LEFT, TOP + HEIGHT * (row + 1) - 0.22, cloud.note, color=QUIET_INK, fontsize=8.0)
    return sheet.figure


def matching_labels(owners: Ints, labels: Ints) -> Ints:
    """(n,) the labels renumbered: those of the owners with which they share most points, then new numbers."""
    names, label = np.unique(labels[labels >= 0], return_inverse=True)
    fragments = np.unique(owners[owners >= 0])
    shared = np.array([[np.sum((owners == f) & (labels == name)) for name in names] for f in fragments])
    shared = shared.reshape(len(fragments), len(names))
    rows, columns = linear_sum_assignment(-shared)
    number = np.arange(len(names)) + int(owners.max(initial=-1)) + 1
    number[columns] = fragments[rows]
    result = np.full(len(labels), -1)
    result[labels >= 0] = number[label.ravel()]
    return result
