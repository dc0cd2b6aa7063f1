"""How well a configuration reached matches its goal (IV-B2)."""

from cutgrammar.geometry.fragment import Configuration, Mesh
from cutgrammar.geometry.overlap import Solid, best_match
from cutgrammar.seams import Scored


def score(reached: Configuration, goal: Configuration) -> Scored:
    """Mean best-matched IoU of `reached` and `goal`, over the matched pairs and strictly.

    Where one of them is known as point clouds only there is no volume to compare: then the scores are unknown.
    """
    if not all(isinstance(fragment.shape, Mesh) for fragment in (*reached, *goal)):
        return unknown(len(reached), len(goal), "point clouds enclose no volume to compare")
    matching = best_match([Solid(f.mesh) for f in reached], [Solid(f.mesh) for f in goal])
    pairs = zip(matching.reached.tolist(), matching.goal.tolist(), matching.ious.tolist(), strict=True)
    return Scored(matching.mean, matching.strict, len(reached), len(goal), tuple(pairs))


def unknown(fragments: int, goal_fragments: int, reason: str) -> Scored:
    """What stands for a score that is not known: no matched IoU, and a strict one of 0."""
    return Scored(None, 0.0, fragments, goal_fragments, (), reason)
