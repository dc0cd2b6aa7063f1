"""Fragments, planes and configurations as the things rerun shows in space."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh, corners_of
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.sampling import cloud_of
from cutgrammar_dashboards.rendering.palette import Colour
from cutgrammar_dashboards.rendering.shading import split_at_creases

POINTS = 384
"""Surface points shown of each fragment."""


def markdown(text: str) -> Any:
    """A text to be read, in Markdown."""
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)


def shape_of(fragment: Fragment, colour: Colour) -> tuple[Any, ...]:
    """The mesh or the points, in the fragment's frame."""
    if not isinstance(fragment.shape, Mesh):
        return (points_of(fragment, colour),)
    vertices, normals, faces, _ = split_at_creases(fragment.shape)
    return (rr.Mesh3D(vertex_positions=vertices, vertex_normals=normals, triangle_indices=faces, albedo_factor=colour),)


def points_of(fragment: Fragment, colour: Colour) -> Any:
    """Points of the surface, in the fragment's frame."""
    cloud = cloud_of(fragment.shape, POINTS)
    return rr.Points3D(cloud.points, colors=colour, radii=rr.Radius.ui_points(2.0))


def pose_of(fragment: Fragment, shift: Floats | None = None) -> Any:
    """Where the fragment lies, moved by `shift` (3,) [m]."""
    position = fragment.X_WF.position if shift is None else fragment.X_WF.position + shift
    return rr.Transform3D(translation=position, mat3x3=fragment.X_WF.rotation)


def corners_W(fragments: Sequence[Fragment]) -> Floats:
    """(n, 3) vertices or points of all fragments in W [m]."""
    return np.vstack([fragment.X_WF.apply(corners_of(fragment.shape)) for fragment in fragments])


def quad(plane: Plane, meant: Sequence[Fragment], margin: float = 1.25) -> Floats:
    """(4, 3) corners in W of a rectangle of the plane that covers the fragments meant, `margin` times their size."""
    points = corners_W(meant)
    upright = np.eye(3)[int(np.argmin(np.abs(plane.normal)))]
    u = np.cross(plane.normal, upright)
    u /= np.linalg.norm(u)
    across = np.stack([u, np.cross(plane.normal, u)])
    low, high = (points @ across.T).min(axis=0), (points @ across.T).max(axis=0)
    middle, half = (low + high) / 2.0, margin * (high - low) / 2.0
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return np.asarray((middle + signs * half) @ across - plane.offset * plane.normal)


def aside(reached: Sequence[Fragment], goal: Configuration) -> Floats:
    """(3,) shift along y that puts the goal beside what was reached, with a gap as wide as the wider."""
    a, b = corners_W(reached), corners_W(goal)
    gap = max(np.ptp(a[:, 1]), np.ptp(b[:, 1]))
    middle = (a.max(axis=0) + a.min(axis=0) - b.max(axis=0) - b.min(axis=0)) / 2.0
    return np.array([middle[0], a[:, 1].max() + gap - b[:, 1].min(), 0.0])
