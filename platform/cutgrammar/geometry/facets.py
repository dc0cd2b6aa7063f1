"""The flat faces of a mesh, e.g. those left by cuts; they do not depend on the triangulation."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane

MAX_BEND = 1e-3
"""Maximum difference between the unit normals of neighbouring triangles of one facet."""
MIN_SHARE = 1e-2
"""Minimum area of a facet, as a share of the surface."""


@dataclass(frozen=True, eq=False)
class Facet:
    """A flat part of a mesh's surface.

    Attributes:
        plane_F: its plane in the mesh's frame F; the normal points out of the mesh.
        centroid: (3,) its centroid in F [m].
        area: its area [m2].
        triangles: (m, 3, 3) corners of its triangles in F [m].
    """

    plane_F: Plane
    centroid: Floats
    area: float
    triangles: Floats


def facets_of(mesh: Mesh) -> tuple[Facet, ...]:
    """The facets of `mesh` by descending area.

    A facet consists of connected triangles with equal normals; curved surfaces have no facet of `MIN_SHARE`. Slivers,
    whose normals are noise, may be missing from their facet.
    """
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    areas_n = np.cross(b - a, c - a) / 2.0
    areas = np.linalg.norm(areas_n, axis=1)
    normals = areas_n / np.maximum(areas, 1e-300)[:, None]
    pairs = _neighbours(mesh.faces)
    flat = np.linalg.norm(normals[pairs[:, 0]] - normals[pairs[:, 1]], axis=1) < MAX_BEND
    joined = pairs[flat]
    graph = coo_array((np.ones(len(joined)), (joined[:, 0], joined[:, 1])), shape=(len(areas), len(areas)))
    count, labels = connected_components(graph, directed=False)
    sizes = np.bincount(labels, weights=areas, minlength=count)
    kept = np.flatnonzero(sizes >= MIN_SHARE * areas.sum())
    found = [_facet(mesh.triangles[labels == i], areas[labels == i], areas_n[labels == i]) for i in kept]
    return tuple(sorted(found, key=lambda facet: -facet.area))


def _facet(triangles: Floats, areas: Floats, areas_n: Floats) -> Facet:
    centroid = areas @ triangles.mean(axis=1) / areas.sum()
    return Facet(Plane.through(centroid, areas_n.sum(axis=0)), centroid, float(areas.sum()), triangles)


def _neighbours(faces: Ints) -> Ints:
    """(p, 2) index pairs of triangles that share an edge."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    same = (edges[order[1:]] == edges[order[:-1]]).all(axis=1)
    return np.asarray(np.stack([order[:-1][same], order[1:][same]], axis=1) // 3)
