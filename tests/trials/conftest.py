"""Small demonstrations that several tests share."""

from functools import cache

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from cutgrammar.demonstrations import DemonstratedCut, DemonstratedFragment, Demonstration
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import slice_mesh


@pytest.fixture(scope="session")
def demonstrate():
    """Makes demonstrations in which lumps are cut through the middle, the largest first; a ninth cut is undone."""
    sphere = trimesh.creation.icosphere(2, 0.03)
    lump = Mesh(sphere.vertices * [1.0, 1.3, 2.0] + 0.003 * np.sin(70 * sphere.vertices[:, [1, 2, 0]]), sphere.faces)

    @cache
    def make(trial=0, setup="N1M1", categories=("slices",), foods=("potato",), cuts=2, seed=7):
        rng = np.random.default_rng([seed, trial])
        fragments = [DemonstratedFragment(i, None, 0, None, lump) for i in range(len(foods))]
        lying = {i: Pose(Rotation.random(rng=rng).as_matrix(), [0.2 * i, 0.1, 0.05]) for i in range(len(foods))}
        poses = {(0, i): X for i, X in lying.items()}
        made = []
        for step in range(1, cuts + 1):
            cut = min(lying, key=lambda i: (-fragments[i].mesh.volume, i))
            mesh, X_WF = fragments[cut].mesh, lying.pop(cut)
            plane_F = Plane.through(mesh.centroid, rng.normal(size=3))
            products = []
            for product in slice_mesh(mesh, plane_F).products:
                products.append(len(fragments))
                fragments.append(DemonstratedFragment(len(fragments), cut, step, categories[0], product))
                lying[products[-1]] = Pose(X_WF.rotation, X_WF.position + rng.normal(0, 0.001, 3))
            plane_C = plane_F.seen_from(canonical_frame(mesh).inverse())
            made.append(DemonstratedCut(step, plane_F.seen_from(X_WF), plane_C, cut, tuple(products), undone=step == 9))
            poses |= {(step, i): X for i, X in lying.items()}
        return Demonstration(trial, setup, foods, categories, "scripted", seed, tuple(fragments), poses, tuple(made))

    return make
