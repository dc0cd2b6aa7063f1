"""Goals as a planner may see them: fragments without names, categories, history, order and inherited frames.

A product of a cut shares its frame and the order of most of its vertices with the fragment it was cut from, which would
reveal the cuts to a planner. Each mesh is therefore expressed in a new frame at its centroid, along the axes of the
world, and its vertices and faces are shuffled.

- `in-place`: the fragments lie where they were cut, as in the paper.
- `scattered`: they are rotated at random and spread out, so that their layout has no information.
- `foreign`, `foreign-food`: they are what other individuals were cut into, one for each object of the trial (see
  `trials.donors`), scaled uniformly to that object's volume. They lie as they were cut, moved so that the donor lies
  where the object lies; or scattered, on request. Nothing of the trial's own fragments is in them.
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
CLEARANCE = 5e-3
"""Gap to which the fragments of two donors are moved apart where their boxes would overlap [m]."""


def goal_for(
    demonstration: Demonstration,
    condition: str,
    rng: np.random.Generator,
    donors: Sequence[DemonstratedObject] = (),
    foreign_layout: str = "in-place",
) -> Configuration:
    """The goal configuration of a trial, reduced to the shapes and positions of its fragments.

    Args:
        demonstration: of the trial; its final configuration is the goal, unless that is foreign.
        condition: one of `GOALS`.
        rng: random stream of this trial's goal.
        donors: for `FOREIGN` conditions, one for each initial object of the demonstration.
        foreign_layout: how foreign goals lie, "in-place" or "scattered".

    Raises:
        InputError: unknown condition.
        ValueError: a foreign goal needs a donor for every object.
    """
    one_of("goal condition", condition, GOALS)
    goal, layout = demonstration.goal, condition
    if condition in FOREIGN:
        goal, layout = _of_donors(demonstration.start, donors), foreign_layout
    goal = tuple(goal[i] for i in rng.permutation(len(goal)))
    if layout == "in-place":
        return tuple(Fragment(_anonymous(f, np.eye(3), rng), Pose(np.eye(3), f.p_WC)) for f in goal)
    rotations = Rotation.random(len(goal), rng=rng).as_matrix()
    meshes = [_anonymous(fragment, rotation, rng) for fragment, rotation in zip(goal, rotations, strict=True)]
    lowest = min(float(fragment.X_WF.apply(fragment.mesh.vertices)[:, 2].min()) for fragment in goal)
    middle = np.mean([fragment.p_WC for fragment in goal], axis=0)
    return tuple(
        Fragment(mesh, Pose(np.eye(3), p_WC))
        for mesh, p_WC in zip(meshes, _spread_out(meshes, middle, lowest), strict=True)
    )


def _of_donors(start: Configuration, donors: Sequence[DemonstratedObject]) -> Configuration:
    """The fragments of the donors, each donor scaled to the volume of the object of `start` that it stands for.

    A donor's centroid lies above that of the object, its lowest point as high as the object's. Donors whose boxes would
    overlap are moved apart along the axis, x or y, in which the objects lie side by side.

    Raises:
        ValueError: the numbers of objects and donors differ.
    """
    if len(donors) != len(start):
        raise ValueError(f"{len(donors)} donors were given for {len(start)} objects; a foreign goal needs one for each")
    groups = [_in_place_of(present, donor) for present, donor in zip(start, donors, strict=True)]
    centres = np.array([fragment.p_WC[:2] for fragment in start])
    axis = int(np.argmax(np.ptp(centres, axis=0)))
    placed: list[tuple[Configuration, tuple[Floats, Floats]]] = []
    for i in np.argsort(centres[:, axis], kind="stable"):
        group, (low, high) = groups[i], _box(groups[i])
        while overlapping := [box for _, box in placed if np.all(low < box[1]) and np.all(box[0] < high)]:
            shift = np.zeros(3)
            shift[axis] = max(box[1][axis] for box in overlapping) + CLEARANCE - low[axis]
            group = tuple(Fragment(f.shape, Pose(f.X_WF.rotation, f.X_WF.position + shift)) for f in group)
            low, high = low + shift[:2], high + shift[:2]
        placed.append((group, (low, high)))
    return tuple(fragment for group, _ in placed for fragment in group)


def _in_place_of(present: Fragment, donor: DemonstratedObject) -> Configuration:
    """The fragments of `donor`, scaled to the volume of `present` and moved to its place."""
    whole = donor.whole
    scale = float(np.cbrt(present.mesh.volume / whole.mesh.volume))
    p_WC = present.p_WC.copy()
    lowest = float(present.X_WF.apply(present.mesh.vertices)[:, 2].min())
    p_WC[2] = lowest + scale * (whole.p_WC[2] - float(whole.X_WF.apply(whole.mesh.vertices)[:, 2].min()))
    return tuple(
        Fragment(
            Mesh(scale * fragment.mesh.vertices, fragment.mesh.faces),
            Pose(fragment.X_WF.rotation, p_WC + scale * (fragment.X_WF.position - whole.p_WC)),
        )
        for fragment in donor.goal
    )


def _box(group: Configuration) -> tuple[Floats, Floats]:
    """Lower and upper corner (2,), (2,) of the fragments' bounding box in x and y [m]."""
    corners = np.vstack([fragment.X_WF.apply(fragment.mesh.vertices)[:, :2] for fragment in group])
    return corners.min(axis=0), corners.max(axis=0)


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
