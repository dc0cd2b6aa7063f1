"""Fragments, planes and configurations as rerun components."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh, vertices_of
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.sampling import cloud_of
from cutgrammar_dashboards.rendering.palette import Colour
from cutgrammar_dashboards.rendering.shading import split_at_creases

POINTS = 384
"""Surface points shown for each fragment."""


def markdown(text: str) -> Any:
    """A Markdown document."""
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)


def shape_of(fragment: Fragment, colour: Colour) -> tuple[Any, ...]:
    """The mesh or the points, in the fragment's frame."""
    shape = fragment.shape
    return (smooth_mesh(shape, colour) if isinstance(shape, Mesh) else points_of(fragment, colour),)


def smooth_mesh(mesh: Mesh, colour: Colour) -> Any:
    """A mesh that is shaded smoothly, with sharp edges where a cut left them."""
    vertices, normals, faces, _ = split_at_creases(mesh)
    return rr.Mesh3D(vertex_positions=vertices, vertex_normals=normals, triangle_indices=faces, albedo_factor=colour)


def points_of(fragment: Fragment, colour: Colour) -> Any:
    """Points on the surface, in the fragment's frame."""
    cloud = cloud_of(fragment.shape, POINTS)
    return rr.Points3D(cloud.points, colors=colour, radii=rr.Radius.ui_points(2.0))


def pose_of(fragment: Fragment, shift: Floats | None = None) -> Any:
    """The pose of the fragment, moved by `shift` (3,) [m]."""
    position = fragment.X_WF.position if shift is None else fragment.X_WF.position + shift
    return rr.Transform3D(translation=position, mat3x3=fragment.X_WF.rotation)


def corners_W(fragments: Sequence[Fragment]) -> Floats:
    """(n, 3) vertices or points of all fragments in W [m]."""
    return np.vstack([fragment.X_WF.apply(vertices_of(fragment.shape)) for fragment in fragments])


def quad(plane: Plane, fragments: Sequence[Fragment], margin: float = 1.25) -> Floats:
    """(4, 3) corners in W of a rectangle in the plane that covers the fragments, `margin` times their size."""
    points = corners_W(fragments)
    upright = np.eye(3)[int(np.argmin(np.abs(plane.normal)))]
    u = np.cross(plane.normal, upright)
    u /= np.linalg.norm(u)
    across = np.stack([u, np.cross(plane.normal, u)])
    low, high = (points @ across.T).min(axis=0), (points @ across.T).max(axis=0)
    middle, half = (low + high) / 2.0, margin * (high - low) / 2.0
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return np.asarray((middle + signs * half) @ across - plane.offset * plane.normal)


def aside(reached: Sequence[Fragment], goal: Configuration) -> Floats:
    """(3,) shift that puts the goal beside the result along y, with a gap as wide as the wider of the two."""
    a, b = corners_W(reached), corners_W(goal)
    gap = max(np.ptp(a[:, 1]), np.ptp(b[:, 1]))
    middle = (a.max(axis=0) + a.min(axis=0) - b.max(axis=0) - b.min(axis=0)) / 2.0
    return np.array([middle[0], a[:, 1].max() + gap - b[:, 1].min(), 0.0])
