"""Fragments as rerun components."""

from typing import Any

import rerun as rr

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.sampling import cloud_of
from cutgrammar_dashboards.rendering.palette import Colour
from cutgrammar_dashboards.rendering.shading import split_at_creases

POINTS = 384
"""Surface points shown for each fragment."""


def markdown(text: str) -> Any:
    """A Markdown document."""
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)


def shape_of(fragment: Fragment, colour: Colour) -> Any:
    """The mesh or the points, in the fragment's frame."""
    return smooth_mesh(fragment.shape, colour) if isinstance(fragment.shape, Mesh) else points_of(fragment, colour)


def smooth_mesh(mesh: Mesh, colour: Colour) -> Any:
    """A mesh that is shaded smoothly, with sharp edges where a cut left them."""
    vertices, normals, faces, _ = split_at_creases(mesh)
    return rr.Mesh3D(vertex_positions=vertices, vertex_normals=normals, triangle_indices=faces, albedo_factor=colour)


def points_of(fragment: Fragment, colour: Colour) -> Any:
    """Points on the surface, in the fragment's frame."""
    cloud = cloud_of(fragment.shape, POINTS)
    return rr.Points3D(cloud.points, colors=colour, radii=rr.Radius.ui_points(2.0))


def pose_of(fragment: Fragment) -> Any:
    """The pose of the fragment."""
    vector = fragment.X_WF.to_vector()
    return rr.Transform3D(translation=vector[:3], quaternion=vector[[4, 5, 6, 3]])


def transforms(vectors: Floats) -> Any:
    """Columns of poses (k, 7), each position x y z [m] and unit quaternion w x y z."""
    return rr.Transform3D.columns(translation=vectors[:, :3], quaternion=vectors[:, [4, 5, 6, 3]])


def scalars(values: Floats) -> Any:
    """Columns of series (k, n)."""
    return rr.Scalars.columns(scalars=values.ravel()).partition([values.shape[1]] * len(values))
