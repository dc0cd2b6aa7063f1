import numpy as np
import pytest

from cutgrammar_dashboards.figures.layout.sheet import sheet_bytes
from pictures.segmentation import SegmentedCloud, matching_labels, segmentation_sheet


def test_labels_get_the_numbers_of_the_fragments_with_which_they_share_most_points():
    owners = np.array([0, 0, 0, 1, 1, 2, -1])
    labels = np.array([7, 7, 3, 3, 3, 9, -1])
    assert matching_labels(owners, labels).tolist() == [0, 0, 1, 1, 1, 2, -1]


def test_an_additional_label_gets_a_new_number():
    assert matching_labels(np.zeros(4, dtype=int), np.array([0, 0, 0, 1])).tolist() == [0, 0, 0, 2]


def test_clouds_are_drawn_reproducibly(rng):
    owners = rng.integers(3, size=200)
    cloud = SegmentedCloud(rng.uniform(0.0, 0.1, size=(200, 3)), owners, owners, "three")
    first, again = (sheet_bytes(segmentation_sheet([cloud], "clouds"), "png") for _ in range(2))
    assert first == again
    assert len(first) > 2000
    with pytest.raises(ValueError, match="no clouds to show"):
        segmentation_sheet([], "none")
