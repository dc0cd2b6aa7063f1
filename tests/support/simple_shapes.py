"""Meshes and fragments of simple shapes for tests."""

import numpy as np
import trimesh

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.pose import Pose


def as_mesh(shape):
    """A trimesh as a `Mesh`."""
    return Mesh(shape.vertices, shape.faces)


def box_mesh(*size):
    """A box with these sides [m], centred at the origin."""
    return as_mesh(trimesh.creation.box(size))


def box_fragment(size, p_WC):
    """A box with these sides [m] and its centre at `p_WC` in W, along the axes of W."""
    return Fragment(box_mesh(*size), Pose(np.eye(3), np.asarray(p_WC)))
