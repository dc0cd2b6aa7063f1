"""Which triangles of a file belong together: the shells of its bodies, also where bodies touch along whole faces.

Two triangles at an edge that no other has are neighbours. Where more than two meet, bodies touch, or a fin without
volume sticks out of one. There the triangles are sorted by their angle about the edge, and the two that bound the same
wedge of matter are neighbours. (manifold3d's import also pairs such triangles, but by their order in the file: two
cubes that share a face came out as one body, two, or torn ones, depending on the order.)
"""

import numpy as np
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from cutgrammar.geometry.arrays import Floats, Ints

SAME_ANGLE = 1e-5
"""Triangles whose angles about an edge differ by no more lie on each other [rad]."""


def merged(vertices: Floats, faces: Ints) -> trimesh.Trimesh:
    """One mesh with coincident vertices merged, and without degenerate triangles and repetitions of a triangle.

    Triangles on each other that face opposite ways stay, unless every triangle of a connected part has such a twin: a
    surface that was saved with two sides is one surface.
    """
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.remove_unreferenced_vertices()
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    a, b, c = mesh.faces.T
    mesh.update_faces((a != b) & (b != c) & (c != a))
    mesh.update_faces(_without_repetitions(np.asarray(mesh.faces)))
    mesh.remove_unreferenced_vertices()
    return mesh


def shells(mesh: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    """The connected shells of a merged mesh, each with vertices of its own, in the order of their first triangles.

    Within a shell every edge has at most two triangles, except where triangles cannot be paired. Fins, which are pairs
    of triangles on each other within one shell, are left out.
    """
    faces = np.asarray(mesh.faces)
    if len(faces) and mesh.is_winding_consistent is False and _most_faces_of_an_edge(faces) <= 2:
        trimesh.repair.fix_winding(mesh)
        faces = np.asarray(mesh.faces)
    if len(faces) and mesh.volume < 0.0:
        faces = faces[:, ::-1]
    while True:
        corners, labels = _joined(np.asarray(mesh.vertices), faces)
        fins = _twins_within(faces, labels)
        if not fins.any():
            break
        faces = faces[~fins]
    found = []
    for label in dict.fromkeys(labels.tolist()):
        own = corners[labels == label]
        _, first, index = np.unique(own, return_index=True, return_inverse=True)
        points = mesh.vertices[faces[labels == label].ravel()[first]]
        found.append(trimesh.Trimesh(points, index.reshape(-1, 3), process=False))
    return found


def edge_counts(faces: Ints) -> tuple[Ints, Ints]:
    """The edges (n, 2) of triangles, as sorted pairs of vertices, and (n,) how many triangles each has."""
    edges, counts = np.unique(np.sort(_edges(faces), axis=1), axis=0, return_counts=True)
    return edges, counts


def _edges(faces: Ints) -> Ints:
    """(3 m, 2): the edge opposite to corner k of triangle i is number 3 i + k."""
    return np.asarray(faces[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2))


def _most_faces_of_an_edge(faces: Ints) -> int:
    return int(edge_counts(faces)[1].max())


def _without_repetitions(faces: Ints) -> Ints:
    """Indices of the triangles to keep."""
    if not len(faces):
        return np.zeros(0, dtype=np.int64)
    keys, which = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True)
    which = which.ravel()
    turned = _is_even(faces)
    first = {sign: np.full(len(keys), -1) for sign in (True, False)}
    for sign in (True, False):
        indices = np.flatnonzero(turned == sign)[::-1]
        first[sign][which[indices]] = indices
    balance = np.bincount(which, weights=np.where(turned, 1.0, -1.0), minlength=len(keys))
    twin = (first[True] >= 0) & (first[False] >= 0) & (balance == 0)
    both = np.where(balance >= 0, np.where(first[True] >= 0, first[True], first[False]), first[False])
    parts = connected_components(
        coo_matrix(
            (np.ones(3 * len(keys)), (np.repeat(keys[:, 0], 3), keys.ravel())), shape=(faces.max() + 1, faces.max() + 1)
        ),
        directed=False,
    )[1][keys[:, 0]]
    two_sided = np.bincount(parts, weights=~twin)[parts] == 0
    kept = np.concatenate([both, first[False][twin & ~two_sided]])
    return np.sort(kept)


def _is_even(faces: Ints) -> Ints:
    """Whether the corners of each triangle are an even permutation of their sorted order."""
    smallest = np.argmin(faces, axis=1)
    rows = np.arange(len(faces))
    return np.asarray(faces[rows, (smallest + 1) % 3] < faces[rows, (smallest + 2) % 3])


def _joined(vertices: Floats, faces: Ints) -> tuple[Ints, Ints]:
    """(m, 3) a number of every corner, equal where neighbours share a vertex, and (m,) the shell of every triangle."""
    pairs = _neighbours(vertices, faces)
    n = 3 * len(faces)
    rows, columns = [], []
    for step in (1, 2):  # the two ends of an edge; neighbours run through it in opposite directions
        ours = 3 * (pairs[:, 0] // 3) + (pairs[:, 0] + step) % 3
        same = faces.ravel()[ours]
        for other in (1, 2):
            theirs = 3 * (pairs[:, 1] // 3) + (pairs[:, 1] + other) % 3
            match = faces.ravel()[theirs] == same
            rows.append(ours[match])
            columns.append(theirs[match])
    a, b = np.concatenate(rows), np.concatenate(columns)
    corners = connected_components(coo_matrix((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False)[1]
    touching = coo_matrix((np.ones(len(pairs)), (pairs[:, 0] // 3, pairs[:, 1] // 3)), shape=(len(faces), len(faces)))
    return corners.reshape(-1, 3), connected_components(touching, directed=False)[1]


def _neighbours(vertices: Floats, faces: Ints) -> Ints:
    """(k, 2) pairs of edges of triangles, by the numbers of `_edges`, at which two triangles of one shell meet."""
    edges = _edges(faces)
    _, which, counts = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    order = np.argsort(which, kind="stable")
    starts = np.concatenate([[0], np.cumsum(counts)])
    two = starts[:-1][counts == 2]
    pairs = [np.column_stack([order[two], order[two + 1]])]
    pairs += [
        _paired(vertices, faces, edges, order[starts[group] : starts[group + 1]])
        for group in np.flatnonzero(counts > 2)
    ]
    return np.concatenate(pairs)


def _paired(vertices: Floats, faces: Ints, edges: Ints, members: Ints) -> Ints:
    """Pairs of the edges `members`, which are one edge of more than two triangles."""
    low = edges[members].min()
    forward = edges[members, 0] == low
    if 2 * forward.sum() != len(members):  # not the surfaces of solids: all are joined, and the shell is refused later
        return np.column_stack([members[:-1], members[1:]])
    begin, end = vertices[low], vertices[edges[members[0]].max()]
    axis = (end - begin) / np.linalg.norm(end - begin)
    across = vertices[faces.ravel()[members]] - begin
    across = across - np.outer(across @ axis, axis)
    reference = across[0] / np.linalg.norm(across[0])
    angles = np.arctan2(across @ np.cross(axis, reference), across @ reference) % (2.0 * np.pi)
    angles[angles > 2.0 * np.pi - SAME_ANGLE] = 0.0
    groups: list[list[int]] = []
    last = -1.0
    for i in np.argsort(angles, kind="stable"):
        if angles[i] - last > SAME_ANGLE:
            groups.append([])
        groups[-1].append(int(i))
        last = angles[i]
    # With growing angle a backward triangle begins matter and a forward one ends it.
    start = next((k for k, group in enumerate(groups) if not any(forward[group])), None)
    inside = start is None  # every triangle has a twin: bodies meet here all around
    ordered: list[int] = []
    for group in groups[start or 0 :] + groups[: start or 0]:
        begins, ends = [i for i in group if not forward[i]], [i for i in group if forward[i]]
        while begins or ends:
            source = (ends or begins) if inside else (begins or ends)
            inside = source is begins
            ordered.append(source.pop(0))
    if start is None:
        ordered = ordered[1:] + ordered[:1]
    return np.asarray(members[np.array(ordered).reshape(-1, 2)])


def _twins_within(faces: Ints, labels: Ints) -> Ints:
    """(m,) whether another triangle of the same shell lies on a triangle."""
    keys = np.column_stack([np.sort(faces, axis=1), labels])
    _, which, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(counts[which.ravel()] > 1)
