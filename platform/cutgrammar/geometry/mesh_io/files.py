"""Reading foods and scans from STL, OBJ, PLY and GLB files, and writing meshes to them.

Files are untrusted: archives are refused, the numbers of bytes and triangles are checked before parsing, and parsing
and repair run in a separate process with limits on memory and time (`parser_process`).
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
MAX_BYTES = 50_000_000
MAX_TRIANGLES = 200_000
TIMEOUT = 180.0
"""Maximum time for reading one file [s]."""


def read_food(path: Path, unit: str | None = None) -> Mesh:
    """Read a food from a mesh file and repair it if that is safe.

    Args:
        path: .stl, .obj, .ply or .glb, closed and without self-intersections.
        unit: unit of the numbers in the file: "mm", "cm" or "m"; None: metres.

    Returns:
        A closed mesh in its frame F [m]: centroid at the origin, longest principal axis along x, second along y. Meshes
        of more than 5,000 faces are simplified; the surface moves by at most 1 % of the largest extent.

    Raises:
        InputError: the file cannot be used; the message is one line and suggests a remedy.
    """
    first, second = _arrays(path, unit, "food")
    return Mesh(first, second)


def read_scan(path: Path, unit: str | None = None) -> Fragment:
    """Read one fragment at its pose: a closed mesh as in `read_food`, or a point cloud (PLY with normals, no faces).

    Args:
        path: .stl, .obj, .ply or .glb, in the world frame W.
        unit: unit of the numbers in the file: "mm", "cm" or "m"; None: metres.

    Returns:
        The fragment; its frame F has the axes of W and its origin at the centroid.

    Raises:
        InputError: the file cannot be used; the message is one line and suggests a remedy.
    """
    first, second = _arrays(path, unit, "scan")
    shape_W = Mesh(first, second) if second.dtype.kind == "i" else Cloud(first, second)
    X_WF = Pose(np.eye(3), shape_W.centroid)
    moved = first - shape_W.centroid
    return Fragment(Mesh(moved, second) if isinstance(shape_W, Mesh) else Cloud(moved, second), X_WF)


def write_mesh(mesh: Mesh, path: Path) -> None:
    """Write a mesh to .stl, .obj, .ply or .glb; all formats but .obj store only about seven digits.

    Raises:
        InputError: unknown suffix.
    """
    one_of("mesh suffix", path.suffix.lower(), SUFFIXES)
    whole = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    options = {"digits": 17} if path.suffix.lower() == ".obj" else {}
    content = whole.export(file_type=path.suffix.lower().removeprefix("."), **options)
    write_atomic(path, content.encode() if isinstance(content, str) else content)


def _checked_bytes(path: Path) -> bytes:
    """Read the whole file.

    Raises:
        InputError: the file is an archive, has an unknown suffix, is too large or empty, or cannot be read.
    """
    suffix, known = path.suffix.lower(), ", ".join(SUFFIXES)
    if suffix in ARCHIVES:
        raise InputError(f"mesh {path} is an archive by its suffix; archives are refused; unpack it to one of {known}")
    if suffix not in SUFFIXES:
        raise InputError(f"mesh {path} has the suffix {suffix!r}; known: {known}; export it as one of them")
    try:
        if not path.is_file():
            raise InputError(f"mesh {path} is not a file" if path.exists() else f"mesh {path} does not exist")
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(f"mesh {path} cannot be read: {error.strerror}") from None
    if len(data) > MAX_BYTES:
        raise InputError(f"mesh {path} is too large: over {MAX_BYTES // 1_000_000} MB; simplify it first")
    if not data:
        raise InputError(f"mesh {path} is empty: it has no bytes; export it again")
    kind = archive_kind(data)
    if kind is not None:
        raise InputError(f"mesh {path} is a {kind} archive by its content; archives are refused; unpack it first")
    return data


def _arrays(path: Path, unit: str | None, kind: str) -> tuple[Any, Any]:
    """Vertices and faces of the file's mesh or, if `kind` is "scan", points and normals of its cloud [m].

    Raises:
        InputError: the file cannot be used.
    """
    if unit is not None:
        one_of("unit", unit, list(UNITS))
    data = _checked_bytes(path)
    suffix = path.suffix.lower()
    try:
        triangles = declared_triangles(data, suffix)
    except InputError as error:
        raise InputError(f"mesh {path} {error}") from None
    if triangles > MAX_TRIANGLES:
        raise InputError(
            f"mesh {path} declares {triangles} triangles or more; at most {MAX_TRIANGLES} are read; simplify it"
        )
    if triangles == 0 and not (kind == "scan" and suffix == ".ply"):
        raise InputError(f"mesh {path} is empty: it has no triangles; export it again")
    return _read_in_child(path, data, suffix, unit, kind)


def _read_in_child(path: Path, data: bytes, suffix: str, unit: str | None, kind: str) -> tuple[Any, Any]:
    command = [sys.executable, "-P", "-m", "cutgrammar.geometry.mesh_io.parser_process", suffix, unit or "", kind]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OPENBLAS_NUM_THREADS": "1"}
    try:
        child = subprocess.run(command, input=data, capture_output=True, timeout=TIMEOUT, env=environment, check=False)
    except subprocess.TimeoutExpired:
        raise InputError(f"mesh {path} takes over {TIMEOUT:.0f} s to read; simplify it first") from None
    messages = child.stderr.decode("utf-8", "replace").strip().splitlines()
    if child.returncode == REFUSED:
        raise InputError(f"mesh {path} {messages[-1]}")
    if child.returncode < 0 or (messages and messages[-1].startswith("MemoryError")):
        raise InputError(f"mesh {path} needs more memory or time to read than a mesh should; export it again")
    if child.returncode:
        raise InputError(
            f"mesh {path} cannot be parsed ({messages[-1] if messages else 'no reason given'}); export it again"
        )
    arrays = io.BytesIO(child.stdout)
    return np.load(arrays, allow_pickle=False), np.load(arrays, allow_pickle=False)
