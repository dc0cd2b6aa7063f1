"""The control `transfer`: the cuts of the goal's own individuals, carried over to the objects at hand.

Under foreign goals every object has a donor, whose fragments are its goal (`trials.donors`). The donor's demonstrated
planes are carried over by one affine map from donor to object: the canonical frames (III-D) coincide, with the signs
under which the boxes fit best, and every axis is scaled by the ratio of the extents. The object is cut by these planes
in advance, which gives a demonstration of how it would be cut; `replay` carries that out.

So it sees a demonstration, though not that of the objects at hand: of these it uses the start alone. It learns nothing,
and shows how far copying the cuts of another individual goes without looking at the shapes that result.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from cutgrammar.demonstration import DemonstratedCut, DemonstratedFragment, DemonstratedObject, Demonstration
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame, extents
from cutgrammar.geometry.fragment import Configuration, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Missed, slice_mesh
from cutgrammar.methods.alignment import aligned_canonical_frame, aligned_frame
from cutgrammar.methods.controls import ReplayPlanner
from cutgrammar.methods.locating import measures
from cutgrammar.methods.method import Method

MIN_SHARE = 1e-3
"""A carried-over plane that leaves less of a fragment's volume on one side is left out."""


@dataclass(frozen=True, eq=False)
class BoxMap:
    """The affine map of a donor onto an object: canonical boxes onto one another.

    Attributes:
        matrix: (3, 3) p_object = matrix @ p_donor + shift, both in the fragment's own frame F.
        shift: (3,) [m].
    """

    matrix: Floats
    shift: Floats

    @staticmethod
    def between(donor: Mesh, present: Mesh) -> "BoxMap":
        """The map under which the canonical box of `donor` becomes that of `present`."""
        scale = float(np.cbrt(present.volume / donor.volume))
        X_DC = canonical_frame(donor)
        X_PC = aligned_canonical_frame(present, Mesh(scale * donor.vertices, donor.faces))
        (low_d, high_d), (low_p, high_p) = extents(donor, X_DC), extents(present, X_PC)
        ratios = (high_p - low_p) / (high_d - low_d)
        matrix = X_PC.rotation @ np.diag(ratios) @ X_DC.rotation.T
        shift = X_PC.apply(low_p - ratios * low_d) - matrix @ X_DC.position
        return BoxMap(matrix, np.asarray(shift))

    def plane(self, plane: Plane) -> Plane:
        """The image of a plane; the side that its normal points to stays the same."""
        normal = np.asarray(np.linalg.solve(self.matrix.T, plane.normal), dtype=np.float64)
        length = float(np.linalg.norm(normal))
        return Plane(normal / length, (plane.offset - float(normal @ self.shift)) / length)


class _Carried:
    """A demonstration in the making: the objects at hand, cut as their donors were."""

    def __init__(self, start: Configuration) -> None:
        self.fragments = [DemonstratedFragment(i, None, 0, None, fragment.mesh) for i, fragment in enumerate(start)]
        self.cuts: list[DemonstratedCut] = []
        self._X_WF = [fragment.X_WF for fragment in start]
        self._alive = [tuple(range(len(start)))]

    def cut(self, fragment: int, plane: Plane) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Cut a fragment by a plane in its frame F; the ids of the products above and below, none if it misses."""
        mesh = self.fragments[fragment].mesh
        sliced = slice_mesh(mesh, plane, MIN_SHARE)
        if isinstance(sliced, Missed):
            return (), ()
        step, first = len(self.cuts) + 1, len(self.fragments)
        ids = tuple(range(first, first + len(sliced.products)))
        self.fragments += [
            DemonstratedFragment(i, fragment, step, None, product)
            for i, product in zip(ids, sliced.products, strict=True)
        ]
        X_WF = self._X_WF[fragment]
        self._X_WF += [X_WF] * len(ids)
        plane_C = plane.transformed(canonical_frame(mesh).inverse())
        self.cuts.append(DemonstratedCut(step, plane.transformed(X_WF), plane_C, fragment, ids))
        self._alive.append((*(i for i in self._alive[-1] if i != fragment), *ids))
        return ids[: len(sliced.above)], ids[len(sliced.above) :]

    @property
    def poses(self) -> Mapping[tuple[int, int], Pose]:
        """(step, fragment id) -> X_WF: nothing moves."""
        return {(step, i): self._X_WF[i] for step, alive in enumerate(self._alive) for i in alive}


def carried_over(of: Demonstration, donors: Sequence[DemonstratedObject]) -> Demonstration:
    """How the objects of `of` would be cut if each were cut as its donor was; of `of`, only the start is used.

    Raises:
        ValueError: the numbers of objects and donors differ.
    """
    if len(donors) != len(of.start):
        raise ValueError(f"{len(donors)} donors were given for {len(of.start)} objects; one for each is needed")
    made = _Carried(of.start)
    for number, donor in enumerate(donors):
        _carry_over(donor, number, made)
    return Demonstration(
        trial=of.trial,
        setup=of.setup,
        foods=of.foods,
        categories=(),
        demonstrator="transfer",
        seed=of.seed,
        fragments=tuple(made.fragments),
        poses=made.poses,
        cuts=tuple(made.cuts),
    )


def _carry_over(donor: DemonstratedObject, number: int, made: _Carried) -> None:
    """Cut object `number` as the donor was cut.

    The donor is cut once more beside it, in the donor's own frame, whatever frames its fragments were recorded in.
    """
    demonstrated = donor.demonstration.fragments
    box_map = BoxMap.between(donor.whole.mesh, made.fragments[number].mesh)
    donor_meshes, present = {donor.number: donor.whole.mesh}, {donor.number: number}
    for cut in donor.cuts:
        if cut.fragment not in donor_meshes or cut.fragment not in present:
            continue  # the plane that would have made it missed the object
        mesh, recorded = donor_meshes[cut.fragment], demonstrated[cut.fragment].mesh
        plane = cut.plane_C.transformed(aligned_frame(mesh, recorded) @ canonical_frame(recorded))
        sliced = slice_mesh(mesh, plane)
        if isinstance(sliced, Missed):
            continue
        sides = made.cut(present[cut.fragment], box_map.plane(plane))
        ids = _recorded_as(sliced.products, {i: demonstrated[i].mesh for i in cut.products})
        for side, products in zip(sides, (sliced.above, sliced.below), strict=True):
            for rank, product in enumerate(products):
                name = ids.get(id(product))
                if name is not None and rank < len(side):
                    donor_meshes[name], present[name] = product, side[rank]


def _recorded_as(products: Sequence[Mesh], recorded: Mapping[int, Mesh]) -> dict[int, int]:
    """The demonstration's number of every product, by the `id` of its mesh, assigned by their measures."""
    names = list(recorded)
    wanted = np.array([measures(recorded[name]) for name in names])
    found = np.array([measures(product) for product in products])
    rows, columns = linear_sum_assignment(np.linalg.norm(found[:, None] - wanted, axis=2))
    return {id(products[row]): names[column] for row, column in zip(rows.tolist(), columns.tolist(), strict=True)}


TRANSFER = Method(
    "transfer",
    lambda context: ReplayPlanner(carried_over(context.require_demonstration(), context.donors)),
    description="the goal's own cuts carried over by canonical frames and extents; foreign goals only",
    kind="control",
    sees_demonstration=True,
    goals=("foreign", "foreign-food"),
    position=5,
    is_deterministic=True,
)
