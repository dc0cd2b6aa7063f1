"""Quality of a segmentation: the IoU of each fragment's points."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from cutgrammar.geometry.arrays import Floats, Ints


def per_fragment_iou(owners: Ints, labels: Ints) -> Floats:
    """(f,) IoU of the points of each true fragment, in order of its index, with those of its matched label.

    Labels and fragments are matched one to one such that the sum of IoU is maximal; a fragment without a label has IoU
    0. Points that belong to no fragment are ignored.

    Args:
        owners: (n,) the true fragment of each point, or a negative number.
        labels: (n,) the label of each point, or a negative number.

    Raises:
        ValueError: no point belongs to a fragment.
    """
    owned = owners >= 0
    if not owned.any():
        raise ValueError("no point belongs to a fragment")
    fragments, owner = np.unique(owners[owned], return_inverse=True)
    names, label = np.unique(labels[owned], return_inverse=True)
    both = np.bincount(owner * len(names) + label, minlength=len(fragments) * len(names))
    both = both.reshape(len(fragments), len(names))
    either = both.sum(axis=1, keepdims=True) + both.sum(axis=0) - both
    iou = np.where(names >= 0, both / either, 0.0)
    rows, columns = linear_sum_assignment(-iou)
    result = np.zeros(len(fragments))
    result[rows] = iou[rows, columns]
    return result
