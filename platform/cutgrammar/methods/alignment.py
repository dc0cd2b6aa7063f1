"""The pose of a demonstrated fragment's frame in the current fragment that corresponds to it.

The signs of a canonical frame are noise for many fragments, so canonical frames alone do not determine the pose. Of the
four choices of signs, the one whose bounding box fits that of the demonstrated fragment best is taken.
"""

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import FLIPS, canonical_frame, extents
from cutgrammar.geometry.fragment import Cloud, Mesh
from cutgrammar.geometry.pose import Pose

DECIMALS = 7
"""Misfits [m] that are equal to this many decimals count as equal; the first of `FLIPS` then wins."""


def aligned_canonical_frame(shape: Mesh | Cloud, model: Mesh) -> Pose:
    """X_FC: the canonical frame C of `shape`, with the signs that make its box most like that of `model` in C."""
    X_FC = canonical_frame(shape)
    box = extents(model, canonical_frame(model))
    return X_FC @ min(FLIPS, key=lambda flip: round(float(_misfits(shape, X_FC @ flip, box).sum()), DECIMALS))


def aligned_frame(shape: Mesh | Cloud, model: Mesh) -> Pose:
    """X_NF: the pose of the frame F of the demonstrated fragment `model` in the frame N of `shape`.

    Worlds that know their fragments leave a product in the frame it was cut in; then N is F. Otherwise, e.g. for
    perceived fragments, the canonical frames are made to coincide. Canonical frames are noise for near-cubes, so they
    must fit twice as well as N = F to be preferred.
    """
    box = model.vertices.min(axis=0), model.vertices.max(axis=0)

    def misfit(X_NF: Pose) -> float:
        return float(_misfits(shape, X_NF, box).max())

    X_FC, X_NC, same = canonical_frame(model), canonical_frame(shape), Pose.identity()
    candidates = [X_NC @ flip @ X_FC.inverse() for flip in FLIPS]
    best = min(candidates, key=lambda X_NF: round(misfit(X_NF), DECIMALS))
    return best if 2.0 * misfit(best) < misfit(same) else same


def _misfits(shape: Mesh | Cloud, X_FA: Pose, box: tuple[Floats, Floats]) -> Floats:
    """(2,) largest distances [m] of the lower and the upper sides of the box of `shape` in A from those of `box`."""
    return np.array([np.abs(side - wanted).max() for side, wanted in zip(extents(shape, X_FA), box, strict=True)])
