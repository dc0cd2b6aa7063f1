"""Names for the fragments of a trial, which carry none: a fragment keeps its name for as long as its shape stays.

A fragment that was moved but not cut keeps the very same shape; what a cut produced has a new one.
"""

import hashlib
from collections.abc import Mapping

import numpy as np

from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh


def shape_digest(fragment: Fragment) -> str:
    """Digest of the shape in its own frame, the same wherever the fragment lies."""
    shape = fragment.shape
    arrays = (shape.vertices, shape.faces) if isinstance(shape, Mesh) else (shape.points, shape.normals)
    digest = hashlib.sha256(type(shape).__name__.encode())
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def followed(before: Mapping[int, Fragment], after: Configuration, first_new: int) -> dict[int, Fragment]:
    """The fragments of `after` under their names, in their order.

    Args:
        before: the fragments there were, by name.
        after: the fragments there are now.
        first_new: name of the first fragment of `after` that was not there before; the others count on from it.
    """
    left: dict[str, list[int]] = {}
    for name, fragment in before.items():
        left.setdefault(shape_digest(fragment), []).append(name)
    names: dict[int, Fragment] = {}
    for fragment in after:
        twins = left.get(shape_digest(fragment), [])
        if twins:  # twins of one shape: the nearest is taken to be the same
            name = min(twins, key=lambda n: (float(np.linalg.norm(before[n].p_WC - fragment.p_WC)), n))
            twins.remove(name)
        else:
            name, first_new = first_new, first_new + 1
        names[name] = fragment
    return names
