"""The allowed imports between packages and rooms, and the package of each heavy library, as data."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FOLDERS = {
    "cutgrammar": "platform",
    "cutgrammar_sim": "sim",
    "cutgrammar_workers": "workers",
    "cutgrammar_dashboards": "dashboards",
    "cutgrammar_pipelines": "pipelines",
}
MAY_IMPORT = {
    "cutgrammar": set(),
    "cutgrammar_sim": {"cutgrammar"},
    "cutgrammar_workers": {"cutgrammar", "cutgrammar_sim"},
    "cutgrammar_dashboards": {"cutgrammar"},
    "cutgrammar_pipelines": {"cutgrammar", "cutgrammar_sim", "cutgrammar_workers", "cutgrammar_dashboards"},
}
LIVES_IN = {
    "trimesh": "cutgrammar",
    "manifold3d": "cutgrammar",
    "torch": "cutgrammar",
    "safetensors": "cutgrammar",
    "numba": ("cutgrammar", "cutgrammar_sim", "cutgrammar_dashboards"),  # compiles inner loops, also those of pictures
    "pyarrow": "cutgrammar",
    "sapien": "cutgrammar_sim",
    "toppra": "cutgrammar_sim",
    "pinocchio": "cutgrammar_sim",
    "coal": "cutgrammar_sim",
    "embreex": "cutgrammar",
    "ray": "cutgrammar_workers",
    "rerun": "cutgrammar_dashboards",
    "matplotlib": "cutgrammar_dashboards",
    "jinja2": "cutgrammar_dashboards",
    "fastapi": "cutgrammar_dashboards",
    "uvicorn": "cutgrammar_dashboards",
    "nicegui": "cutgrammar_dashboards",
    "mlflow": "cutgrammar_pipelines",
    "cyclopts": "cutgrammar_pipelines",
}
ORDER = [
    "geometry",
    "nn",
    "perception",
    "grammar",
    "inference",
    "cutting",
    "fitting",
    "learning",
    "methods",
    "trials",
    "storage",
    "results",
]
"""Rooms of platform/; each may import only itself and those before it."""
SIM_ORDER = ["foods", "physics", "cameras", "arm.robot", "arm.planning", "arm.execution", "demonstrator", "worlds"]
"""The same for sim/."""


def imports():
    for package, folder in FOLDERS.items():
        for path in sorted((ROOT / folder / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Import):
                    names = [alias.name for alias in node.names]
                elif isinstance(node, ast.ImportFrom):
                    assert node.level == 0, f"{path.relative_to(ROOT)}:{node.lineno}: relative import"
                    names = [node.module]
                else:
                    continue
                for name in names:
                    yield path.relative_to(ROOT), node.lineno, package, name


IMPORTS = list(imports())


def test_packages_import_only_allowed_packages():
    for path, line, package, name in IMPORTS:
        top = name.split(".")[0]
        if top in FOLDERS and top != package:
            assert top in MAY_IMPORT[package], f"{path}:{line}: {package} must not import {top}"


def test_heavy_libraries_are_imported_only_in_their_package():
    for path, line, package, name in IMPORTS:
        homes = LIVES_IN.get(name.split(".")[0], package)
        assert package in ([homes] if isinstance(homes, str) else homes), f"{path}:{line}: {name} lives in {homes} only"


def test_rooms_of_the_platform_import_only_earlier_rooms():
    for path, line, package, name in IMPORTS:
        parts = name.split(".")
        if package != "cutgrammar" or parts[0] != "cutgrammar" or len(parts) < 2 or parts[1] not in ORDER:
            continue
        room = path.parts[2]
        if room in ORDER:
            assert ORDER.index(parts[1]) <= ORDER.index(room), f"{path}:{line}: {room} must not import {parts[1]}"


def test_rooms_of_the_simulation_import_only_earlier_rooms():
    def room_of(module):
        return next((room for room in SIM_ORDER if f"{module}.".startswith(f"cutgrammar_sim.{room}.")), None)

    for path, line, package, name in IMPORTS:
        room, imported = room_of(".".join(path.with_suffix("").parts[1:])), room_of(name)
        if package == "cutgrammar_sim" and room and imported:
            assert SIM_ORDER.index(imported) <= SIM_ORDER.index(room), f"{path}:{line}: {room} must not import {name}"


ALSO = {
    "live": {"recording"},
    "report": {"figures", "pages"},
    "demonstrating": {"pages", "figures"},
    "rating": {"pages"},
}
"""What rooms of dashboards/ import beside themselves and rendering."""


def test_rooms_of_the_dashboards_import_only_rendering_and_what_is_listed():
    for path, line, package, name in IMPORTS:
        if package == "cutgrammar_dashboards" and len(path.parts) > 3 and name.startswith(f"{package}."):
            room, imported = path.parts[2], name.split(".")[1]
            assert imported in {room, "rendering", *ALSO.get(room, ())}, (
                f"{path}:{line}: {room} must not import {imported}"
            )


@pytest.mark.parametrize("folder", FOLDERS.values())
def test_every_source_root_contains_exactly_one_package(folder):
    inside = {p.name for p in (ROOT / folder).iterdir() if p.name != "__pycache__"}
    assert inside == {name for name, home in FOLDERS.items() if home == folder}
