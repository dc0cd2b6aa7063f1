"""Users' own foods from STL, OBJ, PLY and GLB files, and meshes written to them.

A file is a stranger's: archives are refused, bytes and triangles are counted before anything is parsed, and parsing
and repair happen in a process of their own with a limit on memory and time (`mesh_child`).
"""

import io
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from cutgrammar.atomic_files import write_atomic
from cutgrammar.errors import InputError, one_of
from cutgrammar.geometry.fragment import Cloud, Fragment, Mesh
from cutgrammar.geometry.mesh_io.headers import archive_kind, declared_triangles
from cutgrammar.geometry.mesh_io.parser_process import REFUSED
from cutgrammar.geometry.mesh_io.repair import UNITS
from cutgrammar.geometry.pose import Pose

SUFFIXES = (".stl", ".obj", ".ply", ".glb")
ARCHIVES = (".zip", ".gz", ".tgz", ".bz2", ".xz", ".lzma", ".7z", ".tar", ".rar", ".zst", ".lz4", ".z")
MOST_BYTES = 50_000_000
MOST_TRIANGLES = 200_000
PATIENCE = 180.0
"""Longest time for reading one file [s]."""


def read_food(path: Path, unit: str | None = None) -> Mesh:
    """A food from a mesh file, repaired if that is safe.

    Args:
        path: .stl, .obj, .ply or .glb, closed and without self-intersections.
        unit: what the file's numbers are in: "mm", "cm", "m"; None: metres.

    Returns:
        A closed mesh in its frame F [m]: centroid at the origin, longest principal axis along x, second along y. Over
        5,000 faces it is simplified, no surface moving by more than 1 % of the largest extent.

    Raises:
        InputError: what is wrong with the file, what would be right and what to try, in one line.
    """
    first, second = _arrays(path, unit, "food")
    return Mesh(first, second)


def read_scan(path: Path, unit: str | None = None) -> Fragment:
    """One fragment where it lies: a closed mesh as for `read_food`, or a point cloud (PLY without faces, with normals).

    Args:
        path: .stl, .obj, .ply or .glb, in the world frame W.
        unit: what the file's numbers are in: "mm", "cm", "m"; None: metres.

    Returns:
        The fragment, its frame F with the axes of W and its origin at the centroid.

    Raises:
        InputError: what is wrong with the file, what would be right and what to try, in one line.
    """
    first, second = _arrays(path, unit, "scan")
    there = Mesh(first, second) if second.dtype.kind == "i" else Cloud(first, second)
    X_WF = Pose(np.eye(3), there.centroid)
    moved = first - there.centroid
    return Fragment(Mesh(moved, second) if isinstance(there, Mesh) else Cloud(moved, second), X_WF)


def write_mesh(mesh: Mesh, path: Path) -> None:
    """Write a mesh to .stl, .obj, .ply or .glb; all but .obj keep about seven digits only.

    Raises:
        InputError: another suffix.
    """
    one_of("mesh suffix", path.suffix.lower(), SUFFIXES)
    whole = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    options = {"digits": 17} if path.suffix.lower() == ".obj" else {}
    content = whole.export(file_type=path.suffix.lower().removeprefix("."), **options)
    write_atomic(path, content.encode() if isinstance(content, str) else content)


def _checked_bytes(path: Path) -> bytes:
    """All bytes of the file.

    Raises:
        InputError: an archive, another suffix, not a file, too large or empty.
    """
    suffix, wanted = path.suffix.lower(), ", ".join(SUFFIXES)
    if suffix in ARCHIVES:
        raise InputError(f"mesh {path} is an archive by its name; archives are refused; unpack it to one of {wanted}")
    if suffix not in SUFFIXES:
        raise InputError(f"mesh {path} has the suffix {suffix!r}; known: {wanted}; export it as one of them")
    try:
        if not path.is_file():
            raise InputError(f"mesh {path} is not a file" if path.exists() else f"mesh {path} does not exist")
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise InputError(f"mesh {path} cannot be read: {error.strerror}") from None
    if len(data) > MOST_BYTES:
        raise InputError(f"mesh {path} is gigantic: over {MOST_BYTES // 1_000_000} MB; simplify it first")
    if not data:
        raise InputError(f"mesh {path} is empty: it holds no bytes; export it again")
    kind = archive_kind(data)
    if kind is not None:
        raise InputError(f"mesh {path} is a {kind} archive, whatever its name; archives are refused; unpack it first")
    return data


def _arrays(path: Path, unit: str | None, kind: str) -> tuple[Any, Any]:
    """Vertices and faces of the file's mesh, or points and normals of its cloud where `kind` is "scan" [m].

    Raises:
        InputError: anything that is wrong with the file.
    """
    if unit is not None:
        one_of("unit", unit, list(UNITS))
    data = _checked_bytes(path)
    suffix = path.suffix.lower()
    try:
        triangles = declared_triangles(data, suffix)
    except InputError as error:
        raise InputError(f"mesh {path} {error}") from None
    if triangles > MOST_TRIANGLES:
        raise InputError(
            f"mesh {path} says it holds {triangles} triangles or more; at most {MOST_TRIANGLES} are read; simplify it"
        )
    if triangles == 0 and not (kind == "scan" and suffix == ".ply"):
        raise InputError(f"mesh {path} is empty: it holds no triangles; export it again")
    return _read_in_child(path, data, suffix, unit, kind)


def _read_in_child(path: Path, data: bytes, suffix: str, unit: str | None, kind: str) -> tuple[Any, Any]:
    command = [sys.executable, "-P", "-m", "cutgrammar.geometry.mesh_io.parser_process", suffix, unit or "", kind]
    surroundings = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OPENBLAS_NUM_THREADS": "1"}
    try:
        child = subprocess.run(
            command, input=data, capture_output=True, timeout=PATIENCE, env=surroundings, check=False
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"mesh {path} takes over {PATIENCE:.0f} s to read; simplify it first") from None
    told = child.stderr.decode("utf-8", "replace").strip().splitlines()
    if child.returncode == REFUSED:
        raise InputError(f"mesh {path} {told[-1]}")
    if child.returncode < 0 or (told and told[-1].startswith("MemoryError")):
        raise InputError(f"mesh {path} needs more memory or time to read than a mesh should; export it again")
    if child.returncode:
        raise InputError(f"mesh {path} cannot be parsed ({told[-1] if told else 'no reason given'}); export it again")
    arrays = io.BytesIO(child.stdout)
    return np.load(arrays, allow_pickle=False), np.load(arrays, allow_pickle=False)
