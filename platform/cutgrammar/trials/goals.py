"""Goals as a planner may see them: fragments without names, categories, history, order and inherited frames.

A product of a cut shares its frame and the order of most of its vertices with the fragment it was cut from, which would
reveal the cuts to a planner. Each mesh is therefore expressed in a new frame at its centroid, along the axes of the
world, and its vertices and faces are shuffled.

- `in-place`: the fragments lie where they were cut, as in the paper.
- `scattered`: they are rotated at random and spread out, so that their layout has no information.
- `foreign`, `foreign-food`: they are what other individuals were cut into, one for each object of the trial (see
  `trials.donors`), scaled uniformly to that object's volume and laid out as those of `scattered` goals. Nothing of the
  trial's own fragments is in them.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from cutgrammar.demonstration import DemonstratedObject, Demonstration
from cutgrammar.errors import one_of
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.pose import Pose

OTHER_FOOD = "foreign-food"
FOREIGN = ("foreign", OTHER_FOOD)
"""The goal conditions whose fragments are those of other individuals."""
GOALS = ("in-place", "scattered", *FOREIGN)


def goal_for(
    demonstration: Demonstration,
    condition: str,
    rng: np.random.Generator,
    donors: Sequence[DemonstratedObject] = (),
) -> Configuration:
    """The goal configuration of a trial, reduced to the shapes and positions of its fragments.

    Args:
        demonstration: of the trial; its final configuration is the goal, unless that is foreign.
        condition: one of `GOALS`.
        rng: random stream of this trial's goal.
        donors: for `FOREIGN` conditions, one for each initial object of the demonstration.

    Raises:
        InputError: unknown condition.
        ValueError: a foreign goal needs a donor for every object.
    """
    one_of("goal condition", condition, GOALS)
    source = scaled_donors(demonstration.start, donors) if condition in FOREIGN else demonstration.goal
    goal = tuple(source[i] for i in rng.permutation(len(source)))
    if condition == "in-place":
        return tuple(Fragment(_anonymous(f, np.eye(3), rng), Pose(np.eye(3), f.p_WC)) for f in goal)
    rotations = Rotation.random(len(goal), rng=rng).as_matrix()
    meshes = [_anonymous(fragment, rotation, rng) for fragment, rotation in zip(goal, rotations, strict=True)]
    placed = demonstration.start if condition in FOREIGN else goal
    lowest = min(float(fragment.X_WF.apply(fragment.mesh.vertices)[:, 2].min()) for fragment in placed)
    middle = np.mean([fragment.p_WC for fragment in placed], axis=0)
    return tuple(
        Fragment(mesh, Pose(np.eye(3), p_WC))
        for mesh, p_WC in zip(meshes, _spread_out(meshes, middle, lowest), strict=True)
    )


def scaled_donors(start: Configuration, donors: Sequence[DemonstratedObject]) -> Configuration:
    """The fragments of the donors, each donor scaled to the volume of the object of `start` that it stands for.

    Raises:
        ValueError: the numbers of objects and donors differ.
    """
    if len(donors) != len(start):
        raise ValueError(f"{len(donors)} donors were given for {len(start)} objects; a foreign goal needs one for each")
    return tuple(
        Fragment(
            Mesh(scale * fragment.mesh.vertices, fragment.mesh.faces),
            Pose(fragment.X_WF.rotation, scale * fragment.X_WF.position),
        )
        for scale, donor in (
            (float(np.cbrt(present.mesh.volume / donor.whole.mesh.volume)), donor)
            for present, donor in zip(start, donors, strict=True)
        )
        for fragment in donor.goal
    )


def _anonymous(fragment: Fragment, rotation: Floats, rng: np.random.Generator) -> Mesh:
    """The fragment's mesh about its centroid, rotated by `rotation` (3, 3) in W, with vertices and faces shuffled."""
    mesh = fragment.mesh
    p_C = rotation @ fragment.X_WF.rotate(mesh.vertices - mesh.centroid).T
    order = rng.permutation(len(mesh.vertices))
    faces = np.argsort(order)[mesh.faces][rng.permutation(len(mesh.faces))]
    # The first corner of each face is random; its orientation is kept.
    corners = (np.arange(3) + rng.integers(3, size=(len(faces), 1))) % 3
    return Mesh(p_C.T[order], np.take_along_axis(faces, corners, axis=1))


def _spread_out(meshes: list[Mesh], middle: Floats, lowest: float) -> Floats:
    """(n, 3) positions on a square grid about `middle` (3,), with the lowest point of each mesh at height `lowest` [m].

    The gap between two meshes is at least the largest diameter: every mesh is within the largest radius r of its
    centroid, so a spacing of 4 r leaves gaps of 2 r, and no diameter exceeds 2 r.
    """
    radius = max(float(np.linalg.norm(mesh.vertices, axis=1).max()) for mesh in meshes)
    side = int(np.ceil(np.sqrt(len(meshes))))
    cells = np.stack(np.divmod(np.arange(len(meshes)), side), axis=1)
    flat = middle[:2] + 4.0 * radius * (cells - cells.mean(axis=0))
    heights = [lowest - float(mesh.vertices[:, 2].min()) for mesh in meshes]
    return np.column_stack([flat, heights])
