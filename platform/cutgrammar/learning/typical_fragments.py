"""What a fragment type looks like: the medoid of the training fragments of that type.

A model holds no fragments, so the classifier gives each training fragment its most probable type. The medoid is the
fragment whose shape feature z has the smallest mean distance from those of the others. A type that is not the most
probable one of any fragment is represented by the fragment for which its probability is highest.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from cutgrammar.demonstration import Demonstration
from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.canonical import canonical_frame, extents
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.learning.model import Model
from cutgrammar.learning.training_fragments import training_fragments

AT_ONCE = 1000
"""Distances from so many fragments are in memory at a time."""


@dataclass(frozen=True, eq=False)
class TypicalFragment:
    """A fragment that represents a type.

    Attributes:
        mesh: of the fragment, in its own frame F [m].
        trial: the trial it comes from.
        count: number of training fragments of the type.
        length: largest distance between two of its vertices along an axis of its canonical frame [m].
    """

    mesh: Mesh
    trial: int
    count: int
    length: float


def typical_fragments(model: Model, demonstrations: Sequence[Demonstration]) -> tuple[TypicalFragment, ...]:
    """The typical fragment of every type, in their order.

    Args:
        model: its classifier gives the fragments their types.
        demonstrations: the model's training trials.
    """
    fragments = training_fragments(demonstrations)
    z = np.array([model.features(mesh) for mesh in fragments.meshes])
    log_p = model.classifier.log_probabilities(z)
    types = log_p.argmax(axis=1)
    chosen = [_medoid(z, np.flatnonzero(types == c), log_p[:, c]) for c in range(model.grammar.k)]
    counts = np.bincount(types, minlength=model.grammar.k)
    return tuple(
        TypicalFragment(fragments.meshes[i], fragments.trials[i], int(count), _length(fragments.meshes[i]))
        for i, count in zip(chosen, counts, strict=True)
    )


def _medoid(z: Floats, members: Ints, log_p: Floats) -> int:
    """The medoid of the members of a type by features (n, 17); without members, the fragment most probably of it."""
    if not len(members):
        return int(log_p.argmax())
    sums = [cdist(z[some], z[members]).sum(axis=1) for some in np.array_split(members, -(-len(members) // AT_ONCE))]
    return int(members[np.concatenate(sums).argmin()])


def _length(mesh: Mesh) -> float:
    low, high = extents(mesh, canonical_frame(mesh))
    return float((high - low).max())
