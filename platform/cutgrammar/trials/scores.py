"""How well a configuration reached matches its goal: best-matched IoU (IV-B2), and three scores beside it.

One matching, that of the greatest sum of IoU, serves all. Whatever is summed over its pairs is divided by the larger
number of fragments, and a fragment without counterpart counts as the worst pair: stopping early cannot win.
"""

from functools import lru_cache

import numpy as np

from cutgrammar.events import Scored
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.comparison.overlap import Solid, best_match
from cutgrammar.geometry.comparison.refinement import refined_iou
from cutgrammar.geometry.comparison.spectrum import frequencies, spectral_distance
from cutgrammar.geometry.fragment import Configuration, Mesh
from cutgrammar.trials.agreement import agrees

KEPT = 512
"""Solids kept at hand, since one goal is scored for many methods."""


def score(reached: Configuration, goal: Configuration) -> Scored:
    """All scores of `reached` against `goal` (see `events.Scored`).

    Where one of them is known as point clouds only there is no volume to compare: then the scores are unknown.
    """
    if not all(isinstance(fragment.shape, Mesh) for fragment in (*reached, *goal)):
        return unknown(len(reached), len(goal), "point clouds enclose no volume to compare")
    ours, theirs = ([_solid(f.mesh) for f in fragments] for fragments in (reached, goal))
    matching = best_match(ours, theirs)
    pairs = tuple(zip(matching.reached.tolist(), matching.goal.tolist(), matching.ious.tolist(), strict=True))
    matched = [(ours[i], theirs[j], plain) for i, j, plain in pairs]
    alone = matching.larger - len(pairs)
    return Scored(
        iou=matching.mean,
        iou_strict=matching.strict,
        fragments=len(reached),
        goal_fragments=len(goal),
        pairs=pairs,
        iou_refined=sum(refined_iou(a, b, plain) for a, b, plain in matched) / matching.larger,
        spectral=(sum(spectral_distance(_frequencies(a), _frequencies(b)) for a, b, _ in matched) + alone)
        / matching.larger,
        agreement=sum(agrees(a, b) for a, b, _ in matched) / matching.larger,
    )


def unknown(fragments: int, goal_fragments: int, reason: str) -> Scored:
    """What stands for scores that are not known: a strict IoU of 0 and nothing else."""
    return Scored(None, 0.0, fragments, goal_fragments, (), reason)


def _solid(mesh: Mesh) -> Solid:
    return _solid_of(mesh.vertices.tobytes(), mesh.faces.tobytes())


@lru_cache(maxsize=KEPT)
def _solid_of(vertices: bytes, faces: bytes) -> Solid:
    """The solid of a mesh with these vertices (n, 3) and faces (m, 3): meshes of one content are one solid."""
    return Solid(Mesh(np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(faces, dtype=np.int64).reshape(-1, 3)))


@lru_cache(maxsize=KEPT)
def _frequencies(solid: Solid) -> Floats:
    return frequencies(solid.mesh)
