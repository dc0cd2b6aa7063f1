"""From the triangles of an untrusted file to a mesh that can be cut: safe repairs, otherwise refusal with a reason.

Repairs: coincident vertices are merged; degenerate and duplicate triangles are removed; faces are oriented consistently
outwards; holes that together are at most `MAX_HOLES` of the surface are filled; and meshes of more than `MAX_FACES`
faces are simplified, with the surface moving by at most `MAX_TOLERANCE` of the largest extent.
"""

import numpy as np
import trimesh

from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Cloud, Mesh
from cutgrammar.geometry.mesh_io.self_intersection import self_intersections
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import mesh_of, solid_of

UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
"""Units of the numbers in a file [m]."""
MIN_EXTENT, MAX_EXTENT = 0.01, 0.5
"""Bounds of a food's largest extent [m]."""
MAX_HOLES = 0.01
"""Maximum area of holes that are filled, as a share of the surface."""
MIN_THICKNESS = 1e-4
"""Minimum thickness of a shape that is not flat, as a share of its largest extent."""
MIN_POINTS = 32
"""Minimum number of points in a cloud of a fragment."""
MAX_FACES = 5_000
"""Meshes of more faces are simplified."""
TOLERANCES = (1e-3, 2e-3, 5e-3, 1e-2)
"""Tolerances of the simplification, tried in turn, as shares of the largest extent."""
MAX_TOLERANCE = TOLERANCES[-1]
CLEAN = "clean it in a mesh editor first"


def food_from(vertices: Floats, faces: Ints, unit: str | None) -> Mesh:
    """As `solid_in_place`, but with the centroid at the origin and the longest principal axes along x and y."""
    return _upright(solid_in_place(vertices, faces, unit))


def solid_in_place(vertices: Floats, faces: Ints, unit: str | None) -> Mesh:
    """A repaired mesh that can be cut, in the frame of the file [m].

    Args:
        vertices: (n, 3) vertices in the unit of the file.
        faces: (m, 3) vertex indices of the triangles.
        unit: "mm", "cm", "m", or None for metres by default.

    Raises:
        InputError: the data cannot be used; the message does not name the file.
    """
    corners = vertices[faces].reshape(-1, 3)
    if not len(corners):
        raise InputError("is empty: it has no triangles; export it again")
    if not np.isfinite(corners).all():
        raise InputError("has coordinates that are not finite (NaN or infinite); export it again")
    extent = _checked_extent(float(np.ptp(corners, axis=0).max()), unit)
    centre = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    # Repairs and checks use a copy of size 1 about the origin, so that their tolerances are relative to the size.
    whole = _repaired((vertices - centre) / float(np.ptp(corners, axis=0).max()), faces)
    unit_size = _simplified(_solid(whole))
    return Mesh(unit_size.vertices * extent + centre * UNITS[unit or "m"], unit_size.faces)


def cloud_in_place(points: Floats, normals: Floats, unit: str | None) -> Cloud:
    """A point cloud of a fragment, in the frame of the file [m].

    Args:
        points: (n, 3) surface points in the unit of the file.
        normals: (n, 3) outward normals of any nonzero length.
        unit: "mm", "cm", "m", or None for metres by default.

    Raises:
        InputError: the data cannot be used; the message does not name the file.
    """
    if len(points) < MIN_POINTS:
        raise InputError(f"has {len(points)} points and no triangles; a cloud needs at least {MIN_POINTS}")
    lengths = np.linalg.norm(normals, axis=1)
    if not (np.isfinite(points).all() and np.isfinite(normals).all() and (lengths > 0).all()):
        raise InputError("has points or normals that are zero or not finite; export it again")
    _checked_extent(float(np.ptp(points, axis=0).max()), unit)
    if _thickness(points) < MIN_THICKNESS:
        raise InputError("is flat: its points are coplanar; a cloud from all sides of a fragment is needed")
    return Cloud(points * UNITS[unit or "m"], normals / lengths[:, None])


def _checked_extent(extent: float, unit: str | None) -> float:
    """The largest extent in metres."""
    if extent <= 0.0:
        raise InputError("is flat: all its vertices are at one point; a solid is needed")
    metres = extent * UNITS[unit or "m"]
    if MIN_EXTENT <= metres <= MAX_EXTENT:
        return metres
    units = [f"--unit {name}" for name, size in UNITS.items() if MIN_EXTENT <= extent * size <= MAX_EXTENT]
    hint = f"try {' or '.join(units)}" if units else "scale it to the size of a food"
    raise InputError(
        f"would be {metres:.3g} m long, read in {unit or 'm'}; "
        f"foods are {MIN_EXTENT:g} m to {MAX_EXTENT:g} m long; {hint}"
    )


def _repaired(vertices: Floats, faces: Ints) -> trimesh.Trimesh:
    """One closed, consistently wound body.

    Raises:
        InputError: the mesh is flat, open or not manifold, or has several bodies or overlapping shells.
    """
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.remove_unreferenced_vertices()
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    a, b, c = mesh.faces.T
    mesh.update_faces((a != b) & (b != c) & (c != a))
    mesh.update_faces(mesh.unique_faces())
    mesh.remove_unreferenced_vertices()
    if not len(mesh.faces) or _thickness(mesh.vertices) < MIN_THICKNESS:
        raise InputError("is flat: it has no thickness; a solid is needed")
    _fill_small_holes(mesh)
    edges = _edge_counts(mesh)
    if (edges == 1).any():
        raise InputError(
            f"is open: {int((edges == 1).sum())} edges have only one face; a closed surface is needed; "
            "fill its holes in a mesh editor first"
        )
    if (edges > 2).any():
        raise InputError(
            f"has {int((edges > 2).sum())} edges with more than two faces; the surface of a solid is needed; {CLEAN}"
        )
    bodies = len(trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.arange(len(mesh.faces))))
    if bodies > 1:
        if len(self_intersections(Mesh(mesh.vertices, mesh.faces))):
            raise InputError(f"intersects itself: its {bodies} shells overlap; one solid is needed; unite them first")
        raise InputError(f"has {bodies} separate bodies or shells; one solid is needed; save them one by one")
    if not mesh.is_winding_consistent:
        trimesh.repair.fix_winding(mesh)
    if not mesh.is_winding_consistent:
        raise InputError(f"has a non-orientable surface (like a Klein bottle); a solid is needed; {CLEAN}")
    if mesh.volume < 0.0:
        mesh.invert()
    return mesh


def _fill_small_holes(mesh: trimesh.Trimesh) -> None:
    if not (_edge_counts(mesh) == 1).any():
        return
    filled = mesh.copy()
    trimesh.repair.fill_holes(filled, use_fan=True)
    if filled.area - mesh.area <= MAX_HOLES * mesh.area:
        mesh.vertices, mesh.faces = filled.vertices, filled.faces


def _edge_counts(mesh: trimesh.Trimesh) -> Ints:
    """Number of faces of every edge."""
    return np.asarray(np.unique(mesh.edges_sorted, axis=0, return_counts=True)[1])


def _thickness(vertices: Floats) -> float:
    """Ratio of the smallest to the largest extent along the principal axes of the points."""
    centred = vertices - vertices.mean(axis=0)
    extents = np.ptp(centred @ np.linalg.eigh(centred.T @ centred).eigenvectors, axis=0)
    return float(extents.min() / extents.max())


def _solid(mesh: trimesh.Trimesh) -> Mesh:
    """Convert to a `Mesh`.

    Raises:
        InputError: the mesh has no volume, intersects itself, or is not the surface of a solid.
    """
    solid = Mesh(mesh.vertices, mesh.faces)
    if solid.volume < MIN_THICKNESS * np.prod(np.ptp(solid.vertices, axis=0)):
        raise InputError("is flat: it encloses no volume; a solid is needed")
    crossing = self_intersections(solid)
    if len(crossing):
        a, b = (int(face) for face in crossing[0])
        raise InputError(f"intersects itself (faces {a} and {b} after merging, possibly others); {CLEAN}")
    try:
        solid_of(solid)
    except ValueError as error:
        raise InputError(f"is not the surface of a solid ({error}); {CLEAN}") from None
    return solid


def _simplified(mesh: Mesh) -> Mesh:
    """Simplify to at most `MAX_FACES` faces with the smallest sufficient tolerance.

    Raises:
        InputError: no tolerance suffices without self-intersections.
    """
    if len(mesh.faces) <= MAX_FACES:
        return mesh
    for tolerance in TOLERANCES:
        simpler = mesh_of(solid_of(mesh).simplify(tolerance))
        if len(simpler.faces) <= MAX_FACES and not len(self_intersections(simpler)):
            return simpler
    raise InputError(
        f"has {len(mesh.faces)} faces and cannot be simplified to {MAX_FACES} within {MAX_TOLERANCE:.0%} of its size; "
        "simplify it in a mesh editor first"
    )


def _upright(mesh: Mesh) -> Mesh:
    X_FC = canonical_frame(mesh)
    z_y_x = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # the longest axis of C is z
    rotated = mesh.moved(Pose(X_FC.rotation @ z_y_x, X_FC.position).inverse())
    return Mesh(rotated.vertices - rotated.centroid, rotated.faces)
