"""Surfaces for the renderer: fragments and robot parts with normals and colours."""

from dataclasses import dataclass, replace

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Cloud, Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar_dashboards.rendering.palette import Colour
from cutgrammar_dashboards.rendering.shading import split_at_creases

GLOSS = 0.14
"""Gloss of fragments in figures."""


@dataclass(frozen=True, eq=False)
class Body:
    """A triangulated surface to be rendered.

    Attributes:
        vertices: (n, 3) in the frame of the picture or, until it is placed, in its own [m].
        normals: (n, 3) unit normals at the vertices.
        faces: (m, 3) vertices of every triangle.
        colours: (3,) of the whole or (m, 3) of the triangles: red, green and blue from 0 to 1.
        gloss: strength of highlights, from 0 to 1.
    """

    vertices: Floats
    normals: Floats
    faces: Ints
    colours: Floats
    gloss: float

    def placed(self, X_WF: Pose) -> "Body":
        """The body in its pose."""
        return replace(self, vertices=X_WF.apply(self.vertices), normals=X_WF.rotate(self.normals))

    def shifted(self, shift: Floats) -> "Body":
        """The body moved by `shift` (3,) [m]."""
        return replace(self, vertices=self.vertices + shift)

    def coloured(self, colour: Colour) -> "Body":
        """The body in another colour."""
        return replace(self, colours=np.array(colour) / 255.0)


def body_of_mesh(mesh: Mesh, colours: Floats, gloss: float) -> Body:
    """A mesh in its own frame, in `colours`: (3,) or, one for each face, (m, 3)."""
    vertices, normals, faces, kept = split_at_creases(mesh)
    return Body(vertices, normals, faces, colours[kept] if colours.ndim == 2 else colours, gloss)


def body_of_fragment(fragment: Fragment, colour: Colour, shift: Floats | None = None) -> Body:
    """A fragment in the world frame, moved by `shift` (3,) [m]; the points of a cloud become small discs."""
    shape, rgb = fragment.shape, np.array(colour) / 255.0
    body = body_of_mesh(shape, rgb, GLOSS) if isinstance(shape, Mesh) else _discs(shape, rgb)
    body = body.placed(fragment.X_WF)
    return body if shift is None else body.shifted(shift)


def _discs(cloud: Cloud, colour: Floats) -> Body:
    """Every point as a hexagon across its normal, small compared with the distance between neighbours."""
    radius = 0.5 * float(np.ptp(cloud.points, axis=0).max()) / np.sqrt(len(cloud.points))
    helper = np.eye(3)[np.abs(cloud.normals).argmin(axis=1)]
    u = np.cross(cloud.normals, helper)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(cloud.normals, u)
    angles = np.arange(6) * np.pi / 3.0
    rims = np.cos(angles)[:, None] * u[:, None] + np.sin(angles)[:, None] * v[:, None]
    vertices = (cloud.points[:, None] + radius * rims).reshape(-1, 3)
    fan = np.array([[0, i, i + 1] for i in range(1, 5)])
    faces = (6 * np.arange(len(cloud.points))[:, None, None] + fan).reshape(-1, 3)
    return Body(vertices, np.repeat(cloud.normals, 6, axis=0), faces, colour, GLOSS)
