"""Contacts between the fragments of a configuration: planes on which flat faces of two fragments touch."""

from collections.abc import Sequence
from dataclasses import dataclass

import manifold3d
import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.facets import Facet, facets_of
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import solid_of

FACING_DEG, GAP = 1.0, 0.5e-3
"""Faces touch if their planes differ by at most this angle [degrees] and distance [m]."""
SAME_DEG, SAME_GAP = 0.5, 0.1e-3
"""Contacts are on the same plane if their planes differ by at most this angle [degrees] and distance [m]."""
MIN_AREA = 1e-7
"""Minimum overlap of faces that touch [m2]."""


@dataclass(frozen=True, eq=False)
class ContactPlane:
    """A plane of contact.

    Attributes:
        plane_W: the plane in the world frame W.
        X_WP: a frame P in the plane, with z along its normal.
        region: the area on which fragments touch, in x and y of P [m].
    """

    plane_W: Plane
    X_WP: Pose
    region: manifold3d.CrossSection

    @property
    def area(self) -> float:
        """Area on which fragments touch [m2]."""
        return float(self.region.area())

    def coverage(self, fragment: Fragment) -> tuple[float, float]:
        """Area of the section of `fragment` by the plane [m2], and the share of it on which fragments touch."""
        X_PF = self.X_WP.inverse() @ fragment.X_WF
        solid = solid_of(fragment.mesh).transform(np.column_stack([X_PF.rotation, X_PF.position]))
        section = solid.slice(0.0)
        area = float(section.area())
        return area, float((section ^ self.region).area()) / area if area > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class _Contact:
    """A contact between two fragments: its plane, centre and the triangles of both sides, in W."""

    plane_W: Plane
    p_WC: Floats
    sides: tuple[Floats, Floats]
    area: float


def contact_planes(configuration: Configuration) -> tuple[ContactPlane, ...]:
    """The planes on which fragments of `configuration` touch, in order of descending contact area.

    Raises:
        TypeError: a fragment has only a point cloud.
    """
    facets = [
        (i, _moved(facet, fragment.X_WF))
        for i, fragment in enumerate(configuration)
        for facet in facets_of(fragment.mesh)
    ]
    remaining = sorted(_contacts(facets), key=lambda contact: -contact.area)
    planes = []
    while remaining:
        first, *others = remaining
        plane_W = first.plane_W
        coplanar = [first, *(contact for contact in others if _on(plane_W, contact))]
        remaining = [contact for contact in others if not _on(plane_W, contact)]
        X_WP = frame_in(plane_W, near=first.p_WC)
        region = manifold3d.CrossSection()
        for contact in coplanar:
            region += _touching(contact.sides, X_WP)
        planes.append(ContactPlane(plane_W, X_WP, region))
    return tuple(sorted(planes, key=lambda plane: -plane.area))


def frame_in(plane_W: Plane, near: Floats) -> Pose:
    """X_WP: a frame whose z is the plane's normal and whose origin is the projection of `near` (3,) onto the plane."""
    z = plane_W.normal
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    foot = near - z * (z @ near + plane_W.offset)
    return Pose(np.column_stack([x, np.cross(z, x), z]), foot)


def _moved(facet: Facet, X_WF: Pose) -> Facet:
    corners = X_WF.apply(facet.triangles.reshape(-1, 3)).reshape(-1, 3, 3)
    return Facet(facet.plane_F.transformed(X_WF), X_WF.apply(facet.centroid), facet.area, corners)


def _contacts(facets: Sequence[tuple[int, Facet]]) -> list[_Contact]:
    """All contacts between facets, given as (index of the fragment, facet in W), of two different fragments."""
    if not facets:
        return []
    owner = np.array([i for i, _ in facets])
    normals = np.array([facet.plane_F.normal for _, facet in facets])
    offsets = np.array([facet.plane_F.offset for _, facet in facets])
    centres = np.array([facet.centroid for _, facet in facets])
    distances = np.abs(centres @ normals.T + offsets)  # of each facet's centre from each facet's plane
    facing = normals @ normals.T < -np.cos(np.radians(FACING_DEG))
    facing &= (np.minimum(distances, distances.T) < GAP) & (owner[:, None] < owner)
    contacts = []
    for i, j in np.argwhere(facing):
        a, b = facets[i][1], facets[j][1]
        first = a if a.area >= b.area else b
        plane_W = _with_canonical_sign(first.plane_F)
        sides = (a.triangles, b.triangles)
        area = float(_touching(sides, frame_in(plane_W, first.centroid)).area())
        if area >= MIN_AREA:
            smaller = b if first is a else a
            contacts.append(_Contact(plane_W, smaller.centroid, sides, area))
    return contacts


def _with_canonical_sign(plane: Plane) -> Plane:
    """The same plane, with its normal oriented so that the component of largest magnitude is positive."""
    if plane.normal[np.argmax(np.abs(plane.normal))] >= 0.0:
        return plane
    return Plane(-plane.normal, -plane.offset)


def _on(plane_W: Plane, contact: _Contact) -> bool:
    parallel = abs(float(plane_W.normal @ contact.plane_W.normal)) > np.cos(np.radians(SAME_DEG))
    return parallel and abs(float(plane_W.distances(contact.p_WC))) < SAME_GAP


def _touching(sides: tuple[Floats, Floats], X_WP: Pose) -> manifold3d.CrossSection:
    """Overlap of triangles (m, 3, 3) and (n, 3, 3) in W, projected along z of P."""
    flat = [X_WP.inverse().apply(side.reshape(-1, 3)).reshape(-1, 3, 3)[:, :, :2] for side in sides]
    first, second = (manifold3d.CrossSection(list(side), manifold3d.FillRule.NonZero) for side in flat)
    return first ^ second
