"""The names that `import cutgrammar` and the other four packages export."""

import ast
import inspect
import runpy
import subprocess
import sys
import tomllib
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
STUBS = {path.parent.name: path for path in sorted(ROOT.glob("*/cutgrammar*/__init__.pyi"))}
EXPORTS = [
    (package, f"{package}.{node.module}", alias.name)
    for package, stub in STUBS.items()
    for node in ast.walk(ast.parse(stub.read_text()))
    if isinstance(node, ast.ImportFrom)
    for alias in node.names
]
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("[0-9]*.py"))
HEAVY = {"numpy", "scipy", "numba", "torch", "trimesh", "manifold3d", "sapien", "pinocchio", "ray", "mlflow", "rerun"}


def test_every_package_has_a_public_surface():
    assert len(STUBS) == 5
    assert len(EXPORTS) == len({(package, name) for package, _, name in EXPORTS})


@pytest.mark.parametrize(("package", "module", "name"), EXPORTS, ids=[f"{p}.{n}" for p, _, n in EXPORTS])
def test_an_exported_name_is_the_one_its_module_defines(package, module, name):
    assert getattr(import_module(package), name) is getattr(import_module(module), name)


@pytest.mark.parametrize(("package", "module", "name"), EXPORTS, ids=[f"{p}.{n}" for p, _, n in EXPORTS])
def test_an_exported_name_is_documented(package, module, name):
    exported = getattr(import_module(package), name)
    if inspect.isclass(exported) or inspect.isfunction(inspect.unwrap(exported)):
        assert exported.__doc__
        return
    if name == "__version__":
        return
    body = ast.parse(Path(import_module(module).__file__).read_text()).body
    for node, after in pairwise(body):
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        if any(isinstance(target, ast.Name) and target.id == name for target in targets):
            assert isinstance(after, ast.Expr), f"{module}.{name} needs a docstring on the line below it"
            assert isinstance(after.value, ast.Constant)
            return
    raise AssertionError(f"{module} does not define {name}")


@pytest.mark.parametrize("package", STUBS)
def test_importing_a_package_loads_no_heavy_library(package):
    code = f"import sys, {package}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not HEAVY & set(done.stdout.split())


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_examples_import_from_the_public_surface_only(example):
    for node in ast.walk(ast.parse(example.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module.startswith("cutgrammar"):
            assert node.module in STUBS, f"{example.name} imports from {node.module}"
        if isinstance(node, ast.Import):
            assert not any(alias.name.startswith("cutgrammar") and "." in alias.name for alias in node.names)


def test_solids_kept_until_exit_are_not_reported_as_leaks():
    code = (
        "import numpy as np\n"
        "from cutgrammar import Fragment, Pose, score\n"
        "from cutgrammar_sim import carrot\n"
        "whole = (Fragment(carrot(np.random.default_rng(0)), Pose.identity()),)\n"
        "score(whole, whole)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == ""


def test_every_exported_name_is_in_the_api_reference():
    hook = runpy.run_path(str(ROOT / "docs" / "scripts" / "api_pages.py"))
    pages = "\n".join(hook["on_page_markdown"](page.read_text()) for page in (ROOT / "docs" / "api").glob("*.md"))
    listed = [line.removeprefix("::: ") for line in pages.splitlines() if line.startswith("::: ")]
    assert sorted(listed) == sorted(f"{module}.{name}" for _, module, name in EXPORTS if name != "__version__")


def test_the_version_is_the_same_everywhere():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert import_module("cutgrammar").__version__ == version
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"\n## {version}" in (ROOT / "CHANGELOG.md").read_text()
