"""From a recorded demonstration and its meshes to a `Demonstration`, if every cut's products come out of its fragment.

A cut is refused unless its plane divides the fragment, and each of the products is one of those that it makes: of its
volume and proportions and, if its mesh is in the frame of the fragment, in its place. What is not on the board is moved
there as a whole.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from cutgrammar.demonstration import CATEGORIES, DemonstratedCut, DemonstratedFragment, Demonstration
from cutgrammar.errors import InputError, listed
from cutgrammar.geometry.canonical import canonical_frame, covariance
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.mesh_io.sizes import MAX_EXTENT, MIN_EXTENT
from cutgrammar.geometry.mesh_io.units import UNITS
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Missed, slice_mesh
from cutgrammar.storage.recorded_files import (
    RecordedCut,
    RecordedDemonstration,
    RecordedPlane,
    RecordedPose,
    RecordedProduct,
)
from cutgrammar.trials.setups import SETUPS

MIN_SHARE = 1e-3
"""Minimum volume of a product, as a share of its fragment, as in the worlds."""
OWN_SHARE, WHOLE_SHARE = 0.10, 0.01
"""A product may differ in volume and in its deviations along its axes by this share of itself, and this share of the
fragment, from what the plane makes."""
PLACE = 0.03
"""How far a product may lie from where the plane makes it, or reach through the plane, in the fragment's frame, as a
share of the fragment's largest extent."""
BOARD, BOARD_Z = (0.25, 0.30), 0.002
"""Half the extents of the board along x and y of W, and how far from its top the lowest point may be [m]."""


@dataclass
class _Fragment:
    """A fragment while the cuts are repeated."""

    id: int
    parent: int | None
    step: int
    category: str | None
    mesh: Mesh


def demonstration_of(
    recorded: RecordedDemonstration, meshes: Mapping[str, Mesh], trial: int
) -> tuple[Demonstration, tuple[str, ...]]:
    """The demonstration with its number in the data set, and notes on what was changed.

    Args:
        recorded: the description.
        meshes: name of a mesh file -> closed mesh in the file's axes [m].
        trial: its number.

    Raises:
        InputError: it contradicts itself; the message begins with the object or the cut.
    """
    repeated = _Repeated(recorded, meshes)
    for step, cut in enumerate(recorded.cuts, start=1):
        try:
            repeated.cut(step, cut)
        except InputError as error:
            raise InputError(f"cut {step}: {error}") from None
    return repeated.finished(trial)


class _Repeated:
    """The fragments of a recorded demonstration, cut by cut."""

    def __init__(self, recorded: RecordedDemonstration, meshes: Mapping[str, Mesh]) -> None:
        self._recorded, self._meshes, self._metres = recorded, meshes, UNITS[recorded.unit]
        name = f"N{len(recorded.objects)}M{len(recorded.categories)}"
        if name not in SETUPS:
            raise InputError(
                f"{len(recorded.objects)} objects cut into {len(recorded.categories)} categories are the setup {name}, "
                f"which is none of {listed(SETUPS)}"
            )
        self._setup = name
        self._fragments: list[_Fragment] = []
        self._now: dict[str, tuple[int, Pose]] = {}
        self._poses: dict[tuple[int, int], Pose] = {}
        self._cuts: list[DemonstratedCut] = []
        self._names: set[str] = set()
        for one in recorded.objects:
            mesh = meshes[one.mesh]
            self._check_size(one.name, mesh)
            self._add(one.name, None, 0, None, mesh, self._pose(one.pose, f"object {one.name}"))
        self._keep(0)

    def cut(self, step: int, cut: RecordedCut) -> None:
        """Repeat a cut, and check that it makes the products that are recorded.

        Raises:
            InputError: it does not.
        """
        if cut.fragment not in self._now:
            gone = "was cut before" if cut.fragment in self._names else "is unknown"
            raise InputError(f"its fragment {cut.fragment!r} {gone}; those that exist: {listed(self._now)}")
        number, X_WF = self._now.pop(cut.fragment)
        whole = self._fragments[number]
        plane_W = self._plane(cut.plane)
        plane_F = plane_W.transformed(X_WF.inverse())
        sliced = slice_mesh(whole.mesh, plane_F, MIN_SHARE)
        if isinstance(sliced, Missed):
            off = plane_F.distances(whole.mesh.vertices)
            raise InputError(
                f"{sliced.reason} {cut.fragment!r}, which lies {1000.0 * off.min():.3g} to {1000.0 * off.max():.3g} mm "
                "from it; a plane is n.v + d = 0 in the world frame and in the file's unit"
            )
        made = self._products(cut, sliced.above, sliced.below, whole.mesh, plane_F)
        first = len(self._fragments)
        for product, mesh in zip(cut.products, made, strict=True):
            pose = X_WF if product.pose is None else self._pose(product.pose, f"product {product.name}")
            self._add(product.name, number, step, product.category, mesh, pose)
        for name, moved in cut.poses.items():
            if name not in self._now:
                raise InputError(f"the pose of {name!r} has no fragment; those that exist: {listed(self._now)}")
            self._now[name] = self._now[name][0], self._pose(moved, f"fragment {name}")
        plane_C = plane_F.transformed(canonical_frame(whole.mesh).inverse())
        self._cuts.append(DemonstratedCut(step, plane_W, plane_C, number, tuple(range(first, len(self._fragments)))))
        self._keep(step)

    def finished(self, trial: int) -> tuple[Demonstration, tuple[str, ...]]:
        """The demonstration, on the board, and what was changed for it.

        Raises:
            InputError: the fragments of the goal have other categories than the demonstration.
        """
        recorded = self._recorded
        goal = {number for number, _ in self._now.values()}
        only = recorded.categories[0] if len(recorded.categories) == 1 else None
        for one in self._fragments:
            one.category = (one.category or only) if one.id in goal else None
            if one.category is not None and one.category not in recorded.categories:
                raise InputError(
                    f"a fragment is of {one.category}, and the categories are {listed(recorded.categories)}"
                )
        shift, notes = self._onto_board()
        poses = {key: Pose(X_WF.rotation, X_WF.position + shift) for key, X_WF in self._poses.items()}
        moved = Pose(np.eye(3), shift)
        demonstration = Demonstration(
            trial=trial,
            setup=self._setup,
            foods=tuple(one.food for one in recorded.objects),
            categories=tuple(name for name in CATEGORIES if name in recorded.categories),
            demonstrator=" ".join(filter(None, ("imported", recorded.demonstrator))),
            seed=0,
            fragments=tuple(
                DemonstratedFragment(one.id, one.parent, one.step, one.category, one.mesh) for one in self._fragments
            ),
            poses=poses,
            cuts=tuple(
                DemonstratedCut(cut.step, cut.plane_W.transformed(moved), cut.plane_C, cut.fragment, cut.products)
                for cut in self._cuts
            ),
        )
        return demonstration, notes

    def _products(
        self, cut: RecordedCut, above: Sequence[Mesh], below: Sequence[Mesh], whole: Mesh, plane_F: Plane
    ) -> list[Mesh]:
        """The meshes of a cut's products, in their order.

        Raises:
            InputError: they are not what the plane makes.
        """
        made, products = [*above, *below], cut.products
        if len(products) != len(made):
            raise InputError(
                f"its plane makes {len(made)} fragments of {cut.fragment!r}, with {_volumes(made)}; "
                f"{len(products)} products are recorded"
            )
        given = [self._meshes[product.mesh] for product in products if product.mesh is not None]
        if not given:
            return made
        if len(given) < len(products):
            raise InputError("some of its products have a mesh and some have none; give all meshes or none")
        for product, mesh in zip(products, given, strict=True):
            self._check_side(product, mesh, whole, plane_F)
        fits = np.array(
            [
                [_is(mesh, one, whole, product.pose is None) for one in made]
                for product, mesh in zip(products, given, strict=True)
            ]
        )
        found = maximum_bipartite_matching(csr_array(fits.astype(np.int8)), perm_type="column")
        if (found < 0).any():
            odd = products[int(np.argmax(found < 0))].name
            raise InputError(
                f"its plane makes fragments of {cut.fragment!r} with {_volumes(made)}; the meshes of its products have "
                f"{_volumes(given)}, and {odd!r} has the volume, the proportions or the place of none that is left; is "
                "the plane in the world frame, where the fragment lies before the cut?"
            )
        return given

    def _check_side(self, product: RecordedProduct, mesh: Mesh, whole: Mesh, plane_F: Plane) -> None:
        if product.pose is not None:  # in a frame of its own
            return
        distances = plane_F.distances(mesh.vertices)
        through = min(max(float(distances.max()), 0.0), max(-float(distances.min()), 0.0))
        if through > PLACE * float(np.ptp(whole.vertices, axis=0).max()):
            raise InputError(
                f"product {product.name!r} reaches {1000.0 * through:.3g} mm through the plane; without a pose, its "
                "mesh is in the frame of the fragment that was cut"
            )

    def _check_size(self, name: str, mesh: Mesh) -> None:
        extent = float(np.ptp(mesh.vertices, axis=0).max())
        if MIN_EXTENT <= extent <= MAX_EXTENT:
            return
        numbers = extent / self._metres
        fitting = [
            f"; in {unit} it would be {1000.0 * numbers * size:.3g} mm"
            for unit, size in UNITS.items()
            if MIN_EXTENT <= numbers * size <= MAX_EXTENT
        ]
        raise InputError(
            f"object {name} is {extent:.3g} m long, in {self._recorded.unit}; foods are {MIN_EXTENT:g} m to "
            f"{MAX_EXTENT:g} m long{''.join(fitting[:1])}"
        )

    def _add(self, name: str, parent: int | None, step: int, category: str | None, mesh: Mesh, pose: Pose) -> None:
        if name in self._names:
            raise InputError(f"the name {name!r} stands twice; every object and product needs its own")
        self._names.add(name)
        self._now[name] = len(self._fragments), pose
        self._fragments.append(_Fragment(len(self._fragments), parent, step, category, mesh))

    def _keep(self, step: int) -> None:
        self._poses |= {(step, number): pose for number, pose in self._now.values()}

    def _onto_board(self) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.float64]], tuple[str, ...]]:
        """(3,) shift [m] that brings the objects onto the board, none if they are there, and a note about it."""
        whole = [self._poses[0, i].apply(self._fragments[i].mesh.vertices) for i in range(len(self._recorded.objects))]
        corners = np.concatenate(whole)
        low, high = corners.min(axis=0), corners.max(axis=0)
        if abs(low[2]) <= BOARD_Z and (low[:2] >= np.negative(BOARD)).all() and (high[:2] <= BOARD).all():
            return np.zeros(3), ()
        shift = -np.array([*(low + high)[:2] / 2.0, low[2]])
        text = ", ".join(f"{1000.0 * part:.1f}" for part in shift)
        return shift, (f"moved as a whole by ({text}) mm onto the middle of the board",)

    def _pose(self, pose: RecordedPose, whose: str) -> Pose:
        length = float(np.linalg.norm(pose.quaternion))
        if abs(length - 1.0) > 0.01:
            raise InputError(f"the quaternion of {whose} has length {length:.3g}; 1 was expected, in the order w x y z")
        return Pose.from_vector([*(self._metres * np.array(pose.position)), *pose.quaternion])

    def _plane(self, plane: RecordedPlane) -> Plane:
        length = float(np.linalg.norm(plane.normal))
        if abs(length - 1.0) > 0.01:
            raise InputError(f"the normal of its plane has length {length:.3g}; 1 was expected")
        return Plane(np.array(plane.normal) / length, self._metres * plane.offset / length)


def _is(mesh: Mesh, made: Mesh, whole: Mesh, in_place: bool) -> bool:
    """Whether a mesh can be the fragment that a plane made of a whole.

    Args:
        mesh: in the frame of the whole if `in_place`, otherwise in any.
        made, whole: in the frame of the whole.
        in_place: whether the place counts.
    """
    size = float(np.ptp(whole.vertices, axis=0).max())
    if in_place and np.linalg.norm(mesh.centroid - made.centroid) > PLACE * size:
        return False
    if abs(mesh.volume - made.volume) > OWN_SHARE * made.volume + WHOLE_SHARE * whole.volume:
        return False
    own, wanted = (np.sqrt(np.linalg.eigvalsh(covariance(one))) for one in (mesh, made))
    return bool((np.abs(own - wanted) <= OWN_SHARE * wanted + WHOLE_SHARE * size).all())


def _volumes(meshes: Sequence[Mesh]) -> str:
    return f"{listed(f'{1e6 * mesh.volume:.3g}' for mesh in meshes)} ml"
