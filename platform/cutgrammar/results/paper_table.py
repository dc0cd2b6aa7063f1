"""Table I of the paper: best-matched IoU and its standard deviation over five runs.

The authors used other foods, demonstrations and meshes, so their numbers do not compare one to one with this project's.
"""

from typing import Any

COLUMNS = ("bc", "qnet", "grammar", "human")
"""The methods by their names in this project, in the paper's order; the paper calls "grammar" Ours."""

PRINTED: dict[str, tuple[tuple[float, float], ...]] = {
    "N1M1": ((0.37, 0.11), (0.40, 0.16), (0.58, 0.08), (0.57, 0.03)),
    "N1M2": ((0.35, 0.08), (0.32, 0.12), (0.49, 0.06), (0.62, 0.07)),
    "N2M1": ((0.44, 0.08), (0.34, 0.16), (0.56, 0.03), (0.62, 0.09)),
    "N2M2": ((0.42, 0.03), (0.29, 0.09), (0.52, 0.04), (0.56, 0.04)),
    "N2M3": ((0.38, 0.03), (0.28, 0.09), (0.52, 0.03), (0.60, 0.04)),
    "N3M4": ((0.38, 0.04), (0.22, 0.08), (0.52, 0.02), (0.56, 0.04)),
}
"""Setup -> mean and standard deviation of every column."""

PRINTED_RATINGS: dict[str, tuple[tuple[float, float], ...]] = {
    "N1M1": ((2.19, 1.07), (2.14, 1.21), (4.32, 0.77), (4.48, 0.96)),
    "N1M2": ((1.76, 0.87), (1.95, 0.87), (3.60, 1.02), (4.86, 0.35)),
    "N2M1": ((1.64, 0.65), (1.19, 0.39), (3.69, 0.89), (4.83, 0.37)),
    "N2M2": ((2.07, 0.86), (1.24, 0.43), (3.74, 0.90), (4.79, 0.56)),
    "N2M3": ((1.73, 0.99), (1.52, 0.92), (3.21, 0.86), (4.81, 0.55)),
    "N3M4": ((1.57, 0.62), (1.26, 0.49), (3.21, 0.86), (4.81, 0.55)),
}
"""The same of Human Rating; the paper prints equal numbers in the last two rows."""


def printed_rows() -> list[dict[str, Any]]:
    """Table I as rows like those of a report: setup, method, `iou_mean` and `iou_std`."""
    return [
        {"setup": setup, "method": method, "iou_mean": mean, "iou_std": spread}
        for setup, cells in PRINTED.items()
        for method, (mean, spread) in zip(COLUMNS, cells, strict=True)
    ]
