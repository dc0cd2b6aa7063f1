"""Names for the fragments of a trial: a fragment keeps its name as long as it keeps its shape.

A fragment that is moved but not cut keeps its shape exactly; the products of a cut have new shapes.
"""

import hashlib
from collections.abc import Mapping, Sequence

import numpy as np

from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh


def shape_digest(fragment: Fragment) -> str:
    """Digest of the shape in its own frame, which does not depend on the pose."""
    shape = fragment.shape
    arrays = (shape.vertices, shape.faces) if isinstance(shape, Mesh) else (shape.points, shape.normals)
    digest = hashlib.sha256(type(shape).__name__.encode())
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def followed(before: Mapping[int, Fragment], after: Configuration, first_new: int) -> dict[int, Fragment]:
    """The fragments of `after` by name, in their order.

    Args:
        before: the previous fragments, by name.
        after: the current fragments.
        first_new: name of the first new fragment; other new fragments get the following numbers.
    """
    if _are_the_same(list(before.values()), after):
        return dict(zip(before, after, strict=True))
    unmatched: dict[str, list[int]] = {}
    for name, fragment in before.items():
        unmatched.setdefault(shape_digest(fragment), []).append(name)
    names: dict[int, Fragment] = {}
    for fragment in after:
        twins = unmatched.get(shape_digest(fragment), [])
        if twins:  # several may have one shape: the nearest is taken to be the same
            name = min(twins, key=lambda n: (float(np.linalg.norm(before[n].p_WC - fragment.p_WC)), n))
            twins.remove(name)
        else:
            name, first_new = first_new, first_new + 1
        names[name] = fragment
    return names


def _are_the_same(before: Sequence[Fragment], after: Configuration) -> bool:
    """Whether each has the very shape of the one in its place, which no other has; most often nothing was cut."""
    shapes = {id(fragment.shape) for fragment in before}
    return len(shapes) == len(before) == len(after) and all(
        a.shape is b.shape for a, b in zip(before, after, strict=True)
    )
