"""Meshes and fragments of simple shapes for tests."""

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.pose import Pose


def as_mesh(shape):
    """A trimesh as a `Mesh`."""
    return Mesh(shape.vertices, shape.faces)


def box_mesh(*size):
    """A box with these sides [m], centred at the origin."""
    return as_mesh(trimesh.creation.box(size))


def box_fragment(size, p_WC, heading=0.0):
    """A box with these sides [m] and its centre at `p_WC` in W, turned by `heading` about the vertical [rad]."""
    return Fragment(box_mesh(*size), Pose(Rotation.from_euler("Z", heading).as_matrix(), np.asarray(p_WC)))
