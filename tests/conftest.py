"""Shapes, poses and small data for several tests; in CI a skipped test counts as a failure.

Golden traces are text files in folders called `golden` next to the tests. If a change of one is intended, rewrite it
with `pytest --update-golden tests/...` and review the difference before committing it.
"""

import os
import signal
import sys
import sysconfig
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from cutgrammar.demonstration import DemonstratedCut, DemonstratedFragment, Demonstration
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import slice_mesh
from two_link_arm import two_link_motion

os.environ["PATH"] = os.pathsep.join([sysconfig.get_path("scripts"), os.environ["PATH"]])
"""As in an environment that was activated: messages name the program without its path."""
signal.signal(signal.SIGINT, signal.default_int_handler)
"""Ctrl-C ends the commands that tests start also where a shell runs the tests in the background, which ignores it."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if report.skipped and os.environ.get("CI") == "true":
        report.outcome = "failed"
        report.longrepr = f"{item.nodeid} was skipped, but CI must provide what it needs: {call.excinfo.value}"
    return report


def pytest_addoption(parser):
    parser.addoption(
        "--update-golden", action="store_true", help="rewrite golden traces instead of comparing with them"
    )


@pytest.fixture
def check_golden(request):
    """Compares a text with a golden file in `golden/` next to the test; with --update-golden it rewrites the file.

    Example: `check_golden("search.txt", trace)`.
    """

    def check(name, text):
        file = Path(request.path).parent / "golden" / name
        text = "\n".join(line.rstrip() for line in text.splitlines()) + "\n"
        if request.config.getoption("--update-golden"):
            file.parent.mkdir(exist_ok=True)
            file.write_text(text)
        assert file.is_file(), f"{file} does not exist; write it with pytest --update-golden {request.path}"
        assert text == file.read_text(), (
            f"{name} has changed; if this is intended, rewrite it with pytest --update-golden"
        )

    return check


@pytest.fixture
def rng():
    return np.random.default_rng(20)


@pytest.fixture
def lump():
    """An irregular closed mesh of the size of a potato, without symmetry."""
    sphere = trimesh.creation.icosphere(3, 0.03)
    v = sphere.vertices * [1.0, 1.3, 2.0]
    v = v + 0.003 * np.sin(70 * v[:, [1, 2, 0]] + [0.3, 1.1, 2.0]) + 0.002 * np.cos(45 * v)
    return Mesh(v, sphere.faces)


@pytest.fixture
def random_pose(rng):
    """Makes random poses within a metre of the origin."""
    return lambda: Pose(Rotation.random(rng=rng).as_matrix(), rng.uniform(-1, 1, 3))


@pytest.fixture
def remeshed(rng):
    """Makes a copy of a mesh with finer triangles, shuffled vertices and faces, and pose X."""

    def make(mesh, X):
        finer = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).subdivide()
        order = rng.permutation(len(finer.vertices))
        faces = np.argsort(order)[finer.faces]
        return Mesh(X.apply(finer.vertices[order]), np.roll(faces[rng.permutation(len(faces))], 1, axis=1))

    return make


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Installs a package of one module with entry points for the length of a test, as pip would, but without pip."""

    def make(module, source, **entry_points):
        """`entry_points`: group without "cutgrammar." -> {name: attribute of the module}."""
        site = tmp_path / f"site-{module}"
        info = site / f"{module}-1.0.dist-info"
        info.mkdir(parents=True)
        (site / f"{module}.py").write_text(source)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
        lines = [
            line
            for group, attributes in entry_points.items()
            for line in (f"[cutgrammar.{group}]", *(f"{name} = {module}:{a}" for name, a in attributes.items()))
        ]
        (info / "entry_points.txt").write_text("\n".join(lines))
        monkeypatch.syspath_prepend(site)
        monkeypatch.delitem(sys.modules, module, raising=False)  # and again at the end, where it was imported

    return make


QUICK = """
[features]
epochs = 5
[induction]
max_k = 10
n_starts = 1
[planes]
epochs = 20
[baselines]
epochs = 20
plane_epochs = 20
[search]
n_searches = 2
max_rounds = 10
"""
"""Settings for short training."""


@pytest.fixture(scope="session")
def quick_settings(tmp_path_factory):
    """A settings file for tests that train or search."""
    file = tmp_path_factory.mktemp("settings") / "quick.toml"
    file.write_text(QUICK)
    return file


@pytest.fixture(scope="session")
def data_folder(tmp_path_factory):
    """A small data set with the paper's split; copy it before changing it."""
    from cutgrammar_pipelines.config import CollectConfig, SplitConfig
    from cutgrammar_pipelines.stages.collect import collect
    from cutgrammar_pipelines.stages.splitting import split

    folder = tmp_path_factory.mktemp("small") / "data"
    collect(CollectConfig(out=folder, trials=16, seed=3, workers=0))
    split(SplitConfig([folder], out=folder))
    return folder


@pytest.fixture(scope="session")
def model_folder(data_folder, quick_settings):
    """A model of the small data set; copy it before changing it."""
    from cutgrammar_pipelines.config import TrainConfig
    from cutgrammar_pipelines.stages.train import train

    return train(TrainConfig(data=data_folder, out=data_folder.parent / "model", settings=quick_settings)).path


@pytest.fixture(scope="session")
def make_motion():
    """Makes synthetic motions: see `two_link_motion`."""
    return two_link_motion


@pytest.fixture(scope="session")
def demonstrate():
    """Makes demonstrations in which the largest lump is cut through its centre; a ninth cut is undone."""
    sphere = trimesh.creation.icosphere(2, 0.03)
    lump = Mesh(sphere.vertices * [1.0, 1.3, 2.0] + 0.003 * np.sin(70 * sphere.vertices[:, [1, 2, 0]]), sphere.faces)

    @cache
    def make(trial=0, setup="N1M1", categories=("slices",), foods=("potato",), cuts=2, seed=7):
        rng = np.random.default_rng([seed, trial])
        fragments = [DemonstratedFragment(i, None, 0, None, lump) for i in range(len(foods))]
        current = {i: Pose(Rotation.random(rng=rng).as_matrix(), [0.2 * i, 0.1, 0.05]) for i in range(len(foods))}
        poses = {(0, i): X for i, X in current.items()}
        made = []
        for step in range(1, cuts + 1):
            cut = min(current, key=lambda i: (-fragments[i].mesh.volume, i))
            mesh, X_WF = fragments[cut].mesh, current.pop(cut)
            plane_F = Plane.through(mesh.centroid, rng.normal(size=3))
            products = []
            for product in slice_mesh(mesh, plane_F).products:
                products.append(len(fragments))
                fragments.append(DemonstratedFragment(len(fragments), cut, step, categories[0], product))
                current[products[-1]] = Pose(X_WF.rotation, X_WF.position + rng.normal(0, 0.001, 3))
            plane_C = plane_F.transformed(canonical_frame(mesh).inverse())
            made.append(
                DemonstratedCut(step, plane_F.transformed(X_WF), plane_C, cut, tuple(products), undone=step == 9)
            )
            poses |= {(step, i): X for i, X in current.items()}
            if step == 9:
                current = {i: X for i, X in current.items() if i not in products} | {cut: X_WF}
                poses |= {(step + 1, i): X for i, X in current.items()}
        fragments = [replace(f, category=f.category if f.id in current else None) for f in fragments]
        return Demonstration(trial, setup, foods, categories, "scripted", seed, tuple(fragments), poses, tuple(made))

    return make
