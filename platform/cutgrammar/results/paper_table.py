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


def printed_rows() -> list[dict[str, Any]]:
    """Table I as rows like those of a report: setup, method, `iou_mean` and `iou_std`."""
    return [
        {"setup": setup, "method": method, "iou_mean": mean, "iou_std": spread}
        for setup, cells in PRINTED.items()
        for method, (mean, spread) in zip(COLUMNS, cells, strict=True)
    ]
