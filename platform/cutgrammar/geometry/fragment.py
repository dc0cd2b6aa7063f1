"""Fragments and configurations (Section II): a fragment is a shape with a pose, a configuration a tuple of fragments.

A shape is a closed triangle mesh or, for fragments that are only perceived, a point cloud. Fragments have no ids: a cut
identifies its fragment by plane and centroid, so perceived and true fragments need no common numbering.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from cutgrammar.geometry.arrays import Floats, Ints, frozen_faces, frozen_floats
from cutgrammar.geometry.pose import Pose


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed, outward-facing triangle mesh in the fragment's frame F.

    Attributes:
        vertices: (n, 3) vertices in F [m].
        faces: (m, 3) vertex indices of the triangles, counter-clockwise seen from outside.
    """

    vertices: Floats
    faces: Ints

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", frozen_floats(self.vertices, (None, 3), "vertices"))
        object.__setattr__(self, "faces", frozen_faces(self.faces, len(self.vertices)))

    def __reduce__(self) -> tuple[Any, ...]:
        return Mesh, (self.vertices, self.faces)

    @cached_property
    def triangles(self) -> Floats:
        """(m, 3, 3) corners of the triangles in F [m]."""
        return np.asarray(self.vertices[self.faces])

    @cached_property
    def volume(self) -> float:
        """Enclosed volume [m3], exact."""
        a, b, c = self._about_middle
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

    @cached_property
    def centroid(self) -> Floats:
        """(3,) centre of the enclosed volume in F [m], exact."""
        a, b, c = self._about_middle
        weights = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
        centroid = self._middle + (weights @ (a + b + c)) / (4.0 * self.volume)
        centroid.setflags(write=False)
        return np.asarray(centroid)

    @cached_property
    def _middle(self) -> Floats:
        return np.asarray((self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2.0)

    @cached_property
    def _about_middle(self) -> tuple[Floats, Floats, Floats]:
        moved = self.triangles - self._middle
        return moved[:, 0], moved[:, 1], moved[:, 2]

    def moved(self, X_GF: Pose) -> "Mesh":
        """The mesh with its vertices expressed in frame G."""
        return Mesh(X_GF.apply(self.vertices), self.faces)


@dataclass(frozen=True, eq=False)
class Cloud:
    """Perceived surface points of a fragment, in the fragment's frame F.

    Attributes:
        points: (n, 3) surface points in F [m].
        normals: (n, 3) outward unit normals in F.
    """

    points: Floats
    normals: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen_floats(self.points, (None, 3), "points"))
        object.__setattr__(self, "normals", frozen_floats(self.normals, (len(self.points), 3), "normals"))

    def __reduce__(self) -> tuple[Any, ...]:
        return Cloud, (self.points, self.normals)

    @cached_property
    def volume(self) -> float:
        """Volume of the points' convex hull [m3].

        Raises:
            scipy.spatial.QhullError: the points lie in a plane.
        """
        return float(ConvexHull(self.points).volume)

    @cached_property
    def centroid(self) -> Floats:
        """(3,) mean of the points in F [m]."""
        return np.asarray(self.points.mean(axis=0))


def vertices_of(shape: Mesh | Cloud) -> Floats:
    """(n, 3) vertices of a mesh or points of a cloud, in the fragment's frame F [m]."""
    return shape.vertices if isinstance(shape, Mesh) else shape.points


@dataclass(frozen=True, eq=False)
class Fragment:
    """An object or fragment: a shape and its pose.

    Attributes:
        shape: closed mesh or point cloud, in the fragment's frame F.
        X_WF: pose of F in the world frame W.
    """

    shape: Mesh | Cloud
    X_WF: Pose

    @cached_property
    def p_WC(self) -> Floats:
        """(3,) centroid in W [m]."""
        return self.X_WF.apply(self.shape.centroid)

    @property
    def mesh(self) -> Mesh:
        """The mesh of a fragment that has one.

        Raises:
            TypeError: the fragment has only a point cloud.
        """
        if not isinstance(self.shape, Mesh):
            raise TypeError("this fragment has only a point cloud, but a mesh is needed")
        return self.shape


Configuration = tuple[Fragment, ...]
"""A configuration: the fragments that exist at one time (II)."""


def same_configuration(a: Configuration, b: Configuration) -> bool:
    """Whether `a` and `b` hold the same shapes, as objects, at the same places and in the same order."""
    return len(a) == len(b) and all(
        x is y or (x.shape is y.shape and np.array_equal(x.X_WF.to_vector(), y.X_WF.to_vector()))
        for x, y in zip(a, b, strict=True)
    )
