"""From the triangles of a stranger's file to a food that can be cut: repaired where safe, refused with a reason.

Repaired: corners that coincide are merged, triangles without three corners and repeated ones dropped, faces turned to
one side and outward, holes that together are at most `SMALL_HOLES` of the surface filled, and meshes of more than
`MOST_FACES` simplified, no surface moving by more than `COARSEST` of the largest extent.
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
"""Units a file may be written in [m]."""
SMALLEST, LARGEST = 0.01, 0.5
"""Largest extent of a food, least and most [m]."""
SMALL_HOLES = 0.01
"""Share of the surface that holes may have to be filled."""
FLAT = 1e-4
"""A shape whose thickness is less than this share of its largest extent counts as flat."""
FEWEST_POINTS = 32
"""Fewer points than this are no cloud of a fragment."""
MOST_FACES = 5_000
"""More faces than this are simplified."""
TOLERANCES = (1e-3, 2e-3, 5e-3, 1e-2)
"""Tolerances of the simplification tried in turn, as shares of the largest extent."""
COARSEST = TOLERANCES[-1]
CLEAN = "clean it in a mesh editor first"


def food_of(vertices: Floats, faces: Ints, unit: str | None) -> Mesh:
    """A mesh that can be cut: centred on its centroid, longest principal axis along x, second along y.

    See `solid_where_it_lies`.
    """
    return _upright(solid_where_it_lies(vertices, faces, unit))


def solid_where_it_lies(vertices: Floats, faces: Ints, unit: str | None) -> Mesh:
    """A mesh that can be cut, in the frame of the file [m].

    Args:
        vertices: (n, 3) corners in the unit of the file.
        faces: (m, 3) indices of the triangles' corners.
        unit: "mm", "cm", "m", or None for metres by default.

    Raises:
        InputError: what is wrong, without the name of the file.
    """
    corners = vertices[faces].reshape(-1, 3)
    if not len(corners):
        raise InputError("is empty: it holds no triangles; export it again")
    if not np.isfinite(corners).all():
        raise InputError("holds coordinates that are not finite numbers (NaN or infinite); export it again")
    extent = _checked_extent(float(np.ptp(corners, axis=0).max()), unit)
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    # Repairs and tests work on a copy of size 1 about the origin, so that their tolerances are shares of the size.
    whole = _repaired((vertices - middle) / float(np.ptp(corners, axis=0).max()), faces)
    unit_size = _simplified(_solid(whole))
    return Mesh(unit_size.vertices * extent + middle * UNITS[unit or "m"], unit_size.faces)


def cloud_where_it_lies(points: Floats, normals: Floats, unit: str | None) -> Cloud:
    """A point cloud of a fragment, in the frame of the file [m].

    Args:
        points: (n, 3) in the unit of the file.
        normals: (n, 3) outward, of any length but zero.
        unit: "mm", "cm", "m", or None for metres by default.

    Raises:
        InputError: what is wrong, without the name of the file.
    """
    if len(points) < FEWEST_POINTS:
        raise InputError(f"holds {len(points)} points and no triangles; a cloud needs at least {FEWEST_POINTS}")
    lengths = np.linalg.norm(normals, axis=1)
    if not (np.isfinite(points).all() and np.isfinite(normals).all() and (lengths > 0).all()):
        raise InputError("holds points or normals that are zero or not finite numbers; export it again")
    _checked_extent(float(np.ptp(points, axis=0).max()), unit)
    if _thickness(points) < FLAT:
        raise InputError("is flat: its points lie in a plane; a cloud from all sides of a fragment is needed")
    return Cloud(points * UNITS[unit or "m"], normals / lengths[:, None])


def _checked_extent(extent: float, unit: str | None) -> float:
    """The largest extent in metres."""
    if extent <= 0.0:
        raise InputError("is flat: all its corners lie in one point; a solid is needed")
    metres = extent * UNITS[unit or "m"]
    if SMALLEST <= metres <= LARGEST:
        return metres
    fits = [f"--unit {name}" for name, size in UNITS.items() if SMALLEST <= extent * size <= LARGEST]
    hint = f"try {' or '.join(fits)}" if fits else "scale it to the size of a food"
    raise InputError(
        f"would be {metres:.3g} m long, read in {unit or 'm'}; foods are {SMALLEST:g} m to {LARGEST:g} m long; {hint}"
    )


def _repaired(vertices: Floats, faces: Ints) -> trimesh.Trimesh:
    """One closed, consistently wound body.

    Raises:
        InputError: flat, several bodies, overlapping shells, open, or with edges of more than two faces.
    """
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.remove_unreferenced_vertices()
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    a, b, c = mesh.faces.T
    mesh.update_faces((a != b) & (b != c) & (c != a))
    mesh.update_faces(mesh.unique_faces())
    mesh.remove_unreferenced_vertices()
    if not len(mesh.faces) or _thickness(mesh.vertices) < FLAT:
        raise InputError("is flat: it has no thickness, hence no volume; a solid is needed")
    _fill_small_holes(mesh)
    edges = _edge_counts(mesh)
    if (edges == 1).any():
        raise InputError(
            f"is open: {int((edges == 1).sum())} edges have a face on one side only; a closed surface is needed; "
            "fill its holes in a mesh editor first"
        )
    if (edges > 2).any():
        raise InputError(
            f"has {int((edges > 2).sum())} edges where more than two faces meet; the surface of a solid is needed; "
            f"{CLEAN}"
        )
    bodies = len(trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.arange(len(mesh.faces))))
    if bodies > 1:
        if len(self_intersections(Mesh(mesh.vertices, mesh.faces))):
            raise InputError(f"runs into itself: its {bodies} shells overlap; one solid is needed; unite them first")
        raise InputError(f"holds {bodies} separate bodies or shells; one solid is needed; save them one by one")
    if not mesh.is_winding_consistent:
        trimesh.repair.fix_winding(mesh)
    if not mesh.is_winding_consistent:
        raise InputError(f"has a surface with one side only (like a Klein bottle); a solid is needed; {CLEAN}")
    if mesh.volume < 0.0:
        mesh.invert()
    return mesh


def _fill_small_holes(mesh: trimesh.Trimesh) -> None:
    if not (_edge_counts(mesh) == 1).any():
        return
    filled = mesh.copy()
    trimesh.repair.fill_holes(filled, use_fan=True)
    if filled.area - mesh.area <= SMALL_HOLES * mesh.area:
        mesh.vertices, mesh.faces = filled.vertices, filled.faces


def _edge_counts(mesh: trimesh.Trimesh) -> Ints:
    """Number of faces at every edge."""
    return np.asarray(np.unique(mesh.edges_sorted, axis=0, return_counts=True)[1])


def _thickness(vertices: Floats) -> float:
    """Smallest extent along the principal axes of the points, as a share of the largest."""
    centred = vertices - vertices.mean(axis=0)
    extents = np.ptp(centred @ np.linalg.eigh(centred.T @ centred).eigenvectors, axis=0)
    return float(extents.min() / extents.max())


def _solid(mesh: trimesh.Trimesh) -> Mesh:
    """The mesh as a value of ours.

    Raises:
        InputError: without volume, running into itself, or not the surface of a solid after all.
    """
    solid = Mesh(mesh.vertices, mesh.faces)
    if solid.volume < FLAT * np.prod(np.ptp(solid.vertices, axis=0)):
        raise InputError("is flat: it encloses no volume; a solid is needed")
    crossing = self_intersections(solid)
    if len(crossing):
        a, b = (int(face) for face in crossing[0])
        raise InputError(f"runs into itself (faces {a} and {b} after merging, perhaps more overlap); {CLEAN}")
    try:
        solid_of(solid)
    except ValueError as error:
        raise InputError(f"is not the surface of a solid ({error}); {CLEAN}") from None
    return solid


def _simplified(mesh: Mesh) -> Mesh:
    """At most `MOST_FACES` faces, by the smallest of `TOLERANCES` that does it.

    Raises:
        InputError: none does it without letting the surface run into itself.
    """
    if len(mesh.faces) <= MOST_FACES:
        return mesh
    for tolerance in TOLERANCES:
        simpler = mesh_of(solid_of(mesh).simplify(tolerance))
        if len(simpler.faces) <= MOST_FACES and not len(self_intersections(simpler)):
            return simpler
    raise InputError(
        f"has {len(mesh.faces)} faces and cannot be simplified to {MOST_FACES} within {COARSEST:.0%} of its size; "
        "simplify it in a mesh editor first"
    )


def _upright(mesh: Mesh) -> Mesh:
    X_FC = canonical_frame(mesh)
    z_y_x = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # C has its longest axis along z
    turned = mesh.moved(Pose(X_FC.rotation @ z_y_x, X_FC.position).inverse())
    return Mesh(turned.vertices - turned.centroid, turned.faces)
