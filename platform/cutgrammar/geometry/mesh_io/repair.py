"""Safe repairs of one shell, otherwise refusal with a reason and the place in the file.

Repairs: faces are oriented consistently outwards; holes that together are at most `MAX_HOLES` of the surface are
filled; meshes of more than `MAX_FACES` faces, and those that intersect themselves, are simplified, with the surface
moving by at most `MAX_TOLERANCE` of the largest extent. Noise keeps dense scans from being simplified: where it does,
it is smoothed by no more than that first (Taubin, A Signal Processing Approach to Fair Surface Design, SIGGRAPH 1995,
which does not shrink what is smooth). What intersects itself then is refused.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn

import manifold3d
import numpy as np
import trimesh

from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.mesh_io.self_intersection import self_intersections
from cutgrammar.geometry.mesh_io.shells import edge_counts
from cutgrammar.geometry.slicing import mesh_of, solid_of

MAX_HOLES = 0.01
"""Maximum area of holes that are filled, as a share of the surface."""
MIN_THICKNESS = 1e-4
"""Minimum thickness of a shape that is not flat, as a share of its largest extent."""
MAX_FACES = 5_000
"""Meshes of more faces are simplified."""
TOLERANCES = (1e-3, 2e-3, 5e-3, 1e-2)
"""Tolerances of the simplification, tried in turn, as shares of the largest extent."""
MAX_TOLERANCE = TOLERANCES[-1]
SMOOTHINGS = (30, 80)
"""Steps of smoothing that are tried in turn where a dense mesh cannot be simplified."""
SMOOTHED_WITHIN = 0.99
"""Share of the vertices that smoothing must move by no more than `MAX_TOLERANCE`; the others are spikes."""
CLEAN = "clean it in a mesh editor first"


@dataclass(frozen=True, eq=False)
class Place:
    """Where a copy of size 1 about the origin has its original.

    Attributes:
        centre: (3,) middle of the original's bounding box, in its numbers.
        size: its largest extent.
    """

    centre: Floats
    size: float

    @staticmethod
    def of(vertices: Floats) -> "Place":
        """That of the bounding box of vertices (n, 3)."""
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        return Place((low + high) / 2.0, float((high - low).max()))

    def inwards(self, vertices: Floats) -> Floats:
        """The original's vertices (n, 3) in the copy."""
        return (vertices - self.centre) / self.size

    def outwards(self, vertices: Floats) -> Floats:
        """The copy's vertices (n, 3) or point (3,) in the original's numbers."""
        return np.asarray(vertices * self.size + self.centre)

    def within(self, outer: "Place") -> "Place":
        """The same, where the original is itself a copy."""
        return Place(outer.outwards(self.centre), self.size * outer.size)

    def text(self, point: Floats) -> str:
        """A point (3,) of the copy, in the original's numbers."""
        return "({:.4g}, {:.4g}, {:.4g})".format(*self.outwards(point))


def with_small_holes_filled(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh, with its holes filled if they are small."""
    if not (edge_counts(np.asarray(mesh.faces))[1] == 1).any():
        return mesh
    filled = mesh.copy()
    trimesh.repair.fill_holes(filled, use_fan=True)
    return filled if filled.area - mesh.area <= MAX_HOLES * mesh.area else mesh


def refuse_open(mesh: trimesh.Trimesh, counts: Ints, place: Place, which: str = "") -> NoReturn:
    """Say why a shell is not closed.

    Raises:
        InputError: always.
    """
    edges = edge_counts(np.asarray(mesh.faces))[0]
    bad = counts == 1 if (counts == 1).any() else counts > 2
    where = place.text(mesh.vertices[edges[np.flatnonzero(bad)[0]]].mean(axis=0))
    if (counts == 1).any():
        raise InputError(
            f"{f'cannot be used: {which}' if which else ''}is open: {int(bad.sum())} edges have only one face, "
            f"one of them at {where}; a closed surface is needed; fill its holes in a mesh editor first"
        )
    raise InputError(
        f"has {int(bad.sum())} edges with more than two faces, one of them at {where}; the surface of a solid is "
        f"needed; {CLEAN}"
    )


def oriented(mesh: trimesh.Trimesh) -> bool:
    """Turn a closed shell's faces outwards; whether they faced inwards before.

    Raises:
        InputError: the surface has no two sides.
    """
    if not mesh.is_winding_consistent:
        trimesh.repair.fix_winding(mesh)
    if not mesh.is_winding_consistent:
        raise InputError(f"has a non-orientable surface (like a Klein bottle); a solid is needed; {CLEAN}")
    inverted = bool(Mesh(mesh.vertices, mesh.faces).volume < 0.0)
    if inverted:
        mesh.faces = np.asarray(mesh.faces)[:, ::-1]
    return inverted


def thickness(vertices: Floats) -> float:
    """Ratio of the smallest to the largest extent along the principal axes of the points."""
    centred = vertices - vertices.mean(axis=0)
    extents = np.ptp(centred @ np.linalg.eigh(centred.T @ centred).eigenvectors, axis=0)
    return float(extents.min() / extents.max())


def sound(
    mesh: Mesh, place: Place, tolerances: Sequence[float] = TOLERANCES, smoothings: Sequence[int] = SMOOTHINGS
) -> tuple[Mesh, str]:
    """A closed mesh of size 1 that encloses a volume, has at most `MAX_FACES` faces and does not intersect itself.

    Dense meshes are simplified before they are tested, because that removes small folds.

    Args:
        mesh: closed and oriented.
        place: where its original is.
        tolerances: of the simplification, tried in turn.
        smoothings: numbers of steps, tried in turn where simplification of a dense mesh fails.

    Returns:
        The mesh and a note on what was changed, or "".

    Raises:
        InputError: it cannot be made so.
    """
    if thickness(mesh.vertices) < MIN_THICKNESS or mesh.volume < MIN_THICKNESS * np.prod(np.ptp(mesh.vertices, axis=0)):
        raise InputError("is flat: it encloses no volume; a solid is needed")
    try:
        solid_of(mesh)
    except ValueError as error:
        raise InputError(f"is not the surface of a solid ({error}); {CLEAN}") from None
    crossing = self_intersections(mesh) if len(mesh.faces) <= MAX_FACES else np.zeros((0, 2), dtype=np.int64)
    if len(mesh.faces) <= MAX_FACES and not len(crossing):
        return mesh, ""
    where = None
    for steps in (0, *(smoothings if len(mesh.faces) > MAX_FACES else ())):
        smooth = _smoothed(mesh, steps) if steps else mesh
        if smooth is None:
            break
        simpler, crossed = _simplified(solid_of(smooth), tolerances)
        if simpler is not None:
            noise = "noise was smoothed, " if steps else ""
            return simpler, f"{noise}{len(mesh.faces)} faces were simplified to {len(simpler.faces)}"
        where = where if steps else crossed
    if len(crossing):
        where = mesh.triangles[crossing[0]].mean(axis=(0, 1))
    if where is not None:
        raise InputError(f"intersects itself near {place.text(where)}, possibly elsewhere too; {CLEAN}")
    raise InputError(
        f"has {len(mesh.faces)} faces and cannot be simplified to {MAX_FACES} within {MAX_TOLERANCE:.0%} of its size, "
        "since its surface is too rough; smooth and simplify it in a mesh editor first"
    )


def _simplified(solid: manifold3d.Manifold, tolerances: Sequence[float]) -> tuple[Mesh | None, Floats | None]:
    """The simplification with the least tolerance that can be used; or None, and where the last one crosses itself."""
    where = None
    for tolerance in tolerances:
        simpler = mesh_of(solid.simplify(tolerance))
        if 0 < len(simpler.faces) <= MAX_FACES:
            crossing = self_intersections(simpler)
            if not len(crossing):
                return simpler, None
            where = simpler.triangles[crossing[0]].mean(axis=(0, 1))
    return None, where


def _smoothed(mesh: Mesh, steps: int) -> Mesh | None:
    """A mesh of size 1 without its noise; None if that moves too much of it, or leaves no solid."""
    smooth = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    trimesh.smoothing.filter_taubin(smooth, lamb=0.5, nu=0.53, iterations=steps)
    moved = np.linalg.norm(smooth.vertices - mesh.vertices, axis=1)
    if np.quantile(moved, SMOOTHED_WITHIN) > MAX_TOLERANCE:
        return None
    found = Mesh(smooth.vertices, mesh.faces)
    try:
        solid_of(found)
    except ValueError:
        return None
    return found
