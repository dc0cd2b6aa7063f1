"""Shapes, poses and small data that several tests share; in CI a skipped test is a failure."""

import os

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.pose import Pose


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if report.skipped and os.environ.get("CI") == "true":
        report.outcome = "failed"
        report.longrepr = f"{item.nodeid} was skipped, and CI must have what it needs: {call.excinfo.value}"
    return report


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


QUICK = """
[features]
epochs = 5
[induction]
largest_k = 10
restarts = 1
[planes]
epochs = 20
[baselines]
epochs = 20
plane_epochs = 20
[search]
keys = 2
rounds = 10
"""
"""Settings that learn little in little time."""


@pytest.fixture(scope="session")
def quick_settings(tmp_path_factory):
    """A settings file for tests that train or search."""
    file = tmp_path_factory.mktemp("settings") / "quick.toml"
    file.write_text(QUICK)
    return file


@pytest.fixture(scope="session")
def data_folder(tmp_path_factory):
    """A small data set with the paper's split; copy it before changing it."""
    from cutgrammar_pipelines.collect import collect
    from cutgrammar_pipelines.splitting import split

    folder = tmp_path_factory.mktemp("small") / "data"
    collect(folder, trials=16, seed=3, workers=0)
    split([folder], folder)
    return folder


@pytest.fixture(scope="session")
def model_folder(data_folder, quick_settings):
    """A model of the small data set; copy it before changing it."""
    from cutgrammar.settings import load_settings
    from cutgrammar_pipelines.train import train

    train(data_folder, data_folder.parent / "model", settings=load_settings(quick_settings))
    return data_folder.parent / "model"
