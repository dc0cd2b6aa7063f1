"""Goals as a planner may see them: fragments without name, category, history, order or inherited frame.

A fragment cut from another shares its frame and most of its vertices' order with it, which would tell a planner what
was cut from what. So each mesh is seen from a frame of its own, at its centroid and along the world's axes, and its
vertices and faces are shuffled. `in-place` goals lie as they were cut, as in the paper; `scattered` ones are turned at
random and laid apart, so that their layout says nothing.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import one_of
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.pose import Pose

GOALS = ("in-place", "scattered")


def goal_for(demonstration: Demonstration, condition: str, rng: np.random.Generator) -> Configuration:
    """The goal configuration of a demonstration, stripped of all but the fragments' shapes and where they lie.

    Args:
        demonstration: whose final configuration is the goal.
        condition: one of `GOALS`.
        rng: the stream of this trial's goal.

    Raises:
        InputError: an unknown condition.
    """
    one_of("goal condition", condition, GOALS)
    goal = [demonstration.goal[i] for i in rng.permutation(len(demonstration.goal))]
    if condition == "in-place":
        return tuple(Fragment(_anonymous(f, np.eye(3), rng), Pose(np.eye(3), f.p_WC)) for f in goal)
    turns = Rotation.random(len(goal), rng=rng).as_matrix()
    meshes = [_anonymous(fragment, turn, rng) for fragment, turn in zip(goal, turns, strict=True)]
    lowest = min(float(fragment.X_WF.apply(fragment.mesh.vertices)[:, 2].min()) for fragment in goal)
    middle = np.mean([fragment.p_WC for fragment in goal], axis=0)
    return tuple(
        Fragment(mesh, Pose(np.eye(3), p_WC)) for mesh, p_WC in zip(meshes, _apart(meshes, middle, lowest), strict=True)
    )


def _anonymous(fragment: Fragment, turn: Floats, rng: np.random.Generator) -> Mesh:
    """The fragment's mesh about its centroid, along the world's axes after `turn` (3, 3), in an order of its own."""
    mesh = fragment.mesh
    about = turn @ fragment.X_WF.rotate(mesh.vertices - mesh.centroid).T
    order = rng.permutation(len(mesh.vertices))
    faces = np.argsort(order)[mesh.faces][rng.permutation(len(mesh.faces))]
    corners = (
        np.arange(3) + rng.integers(3, size=(len(faces), 1))
    ) % 3  # which corner comes first, not which way round
    return Mesh(about.T[order], np.take_along_axis(faces, corners, axis=1))


def _apart(meshes: list[Mesh], middle: Floats, lowest: float) -> Floats:
    """(n, 3) places on a square grid about `middle` (3,), such that all stand on height `lowest` [m].

    Whatever their turn, the gap between any two is at least the largest diameter: a mesh reaches no further from its
    centroid than the largest radius r, so a spacing of 4 r leaves gaps of 2 r, and no diameter exceeds 2 r.
    """
    radius = max(float(np.linalg.norm(mesh.vertices, axis=1).max()) for mesh in meshes)
    side = int(np.ceil(np.sqrt(len(meshes))))
    cells = np.stack(np.divmod(np.arange(len(meshes)), side), axis=1)
    flat = middle[:2] + 4.0 * radius * (cells - cells.mean(axis=0))
    heights = [lowest - float(mesh.vertices[:, 2].min()) for mesh in meshes]
    return np.column_stack([flat, heights])
