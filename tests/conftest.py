"""Shapes and poses that several tests share."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.pose import Pose


@pytest.fixture
def rng():
    return np.random.default_rng(20)


@pytest.fixture
def lump():
    """An irregular closed mesh the size of a potato, with no symmetry."""
    sphere = trimesh.creation.icosphere(3, 0.03)
    v = sphere.vertices * [1.0, 1.3, 2.0]
    v = v + 0.003 * np.sin(70 * v[:, [1, 2, 0]] + [0.3, 1.1, 2.0]) + 0.002 * np.cos(45 * v)
    return Mesh(v, sphere.faces)


@pytest.fixture
def random_pose(rng):
    """Makes poses anywhere within a metre."""
    return lambda: Pose(Rotation.random(rng=rng).as_matrix(), rng.uniform(-1, 1, 3))


@pytest.fixture
def remeshed(rng):
    """Makes a copy of a mesh with finer triangles, another order of vertices and faces, and another pose."""

    def make(mesh, X):
        finer = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).subdivide()
        order = rng.permutation(len(finer.vertices))
        faces = np.argsort(order)[finer.faces]
        return Mesh(X.apply(finer.vertices[order]), np.roll(faces[rng.permutation(len(faces))], 1, axis=1))

    return make
