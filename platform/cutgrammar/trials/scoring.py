"""Score a configuration reached against its goal by any number of scores, which share one matching."""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from cutgrammar.events import DECIDING_SCORE, Scored
from cutgrammar.geometry.comparison.overlap import Solid, best_match
from cutgrammar.geometry.fragment import Configuration, Mesh
from cutgrammar.trials.built_in_scores import COMPUTED
from cutgrammar.trials.scores import Comparison, Score

MAX_CACHED = 512
"""Solids kept in memory, since one goal is scored for many methods."""


def score(reached: Configuration, goal: Configuration, scores: Sequence[Score] = COMPUTED) -> Scored:
    """The scores of `reached` against `goal`; unknown where one of them holds point clouds, which have no volume.

    Raises:
        ValueError: a score is not a finite number.
    """
    if not all(isinstance(fragment.shape, Mesh) for fragment in (*reached, *goal)):
        return unknown(len(reached), len(goal), "point clouds enclose no volume to compare", scores)
    comparison = compare(reached, goal)
    values = {each.name: each.compute(comparison) for each in scores if each.compute is not None}
    for name, value in values.items():
        if value is not None and not math.isfinite(value):
            raise ValueError(f"score {name} is {value}; it must be a finite number, or None where it is not known")
    matching = comparison.matching
    return Scored(
        scores={name: None if value is None else float(value) for name, value in values.items()},
        fragments=len(reached),
        goal_fragments=len(goal),
        pairs=tuple(zip(matching.reached.tolist(), matching.goal.tolist(), matching.ious.tolist(), strict=True)),
    )


def unknown(fragments: int, goal_fragments: int, reason: str, scores: Sequence[Score] = COMPUTED) -> Scored:
    """An event that says that no score is known; the deciding one counts as its worst."""
    values = {each.name: each.worst if each.name == DECIDING_SCORE else None for each in scores}
    return Scored(values, fragments, goal_fragments, (), reason)


def compare(reached: Configuration, goal: Configuration) -> Comparison:
    """The comparison that scores are computed from; all shapes are meshes."""
    reached_solids, goal_solids = (tuple(_solid(fragment.mesh) for fragment in side) for side in (reached, goal))
    return Comparison(reached, goal, reached_solids, goal_solids, best_match(reached_solids, goal_solids))


def _solid(mesh: Mesh) -> Solid:
    return _solid_of(mesh.vertices.tobytes(), mesh.faces.tobytes())


@lru_cache(maxsize=MAX_CACHED)
def _solid_of(vertices: bytes, faces: bytes) -> Solid:
    """The solid of a mesh with these vertices (n, 3) and faces (m, 3): meshes with equal content are one solid."""
    return Solid(Mesh(np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(faces, dtype=np.int64).reshape(-1, 3)))
