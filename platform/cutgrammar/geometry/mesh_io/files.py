"""Reading foods and scans from STL, OBJ, PLY and GLB files, and writing meshes to them.

Files are untrusted: archives are refused, the numbers of bytes and triangles are checked before parsing, and parsing
and repair run in a separate process with limits on memory and time (`parser_process`).
"""

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from cutgrammar.atomic_files import write_atomic
from cutgrammar.errors import InputError, one_of
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.mesh_io.bodies import Keep, one_body
from cutgrammar.geometry.mesh_io.headers import archive_kind, declared_triangles
from cutgrammar.geometry.mesh_io.sizes import checked_scale, long_side
from cutgrammar.geometry.mesh_io.units import UNITS
from cutgrammar.geometry.pose import Pose
from cutgrammar.untrusted.parser_processes import REFUSED, TIMEOUT, run_parser

SUFFIXES = (".stl", ".obj", ".ply", ".glb")
ARCHIVES = (".zip", ".gz", ".tgz", ".bz2", ".xz", ".lzma", ".7z", ".tar", ".rar", ".zst", ".lz4", ".z")
MAX_BYTES = 50_000_000
MAX_TRIANGLES = 200_000


@dataclass(frozen=True, eq=False)
class Scan:
    """What is in one file.

    Attributes:
        path: the file.
        bodies: its solid bodies, where they lie, in the file's numbers and axes.
        notes: what was changed to get them.
    """

    path: Path
    bodies: tuple[Mesh, ...]
    notes: tuple[str, ...]


def read_scan(path: Path, keep: Keep = "all") -> Scan:
    """Read fragments as they lie: the bodies of a mesh, or the solid around whose surface a point cloud was taken.

    Args:
        path: .stl, .obj, .ply or .glb; a PLY file without faces is a point cloud of one fragment.
        keep: which bodies to keep, see `bodies.Keep`.

    Raises:
        InputError: the file cannot be used; the message is one line and suggests a remedy.
    """
    data = _checked_bytes(path)
    suffix = path.suffix.lower()
    if _triangles(path, data, suffix) == 0 and suffix != ".ply":
        raise InputError(f"mesh {path} is empty: it has no triangles; export it again")
    return _read_in_child(path, data, suffix, keep)


def read_food(path: Path, unit: str | None = None, keep: Keep = "all", length: float | None = None) -> Mesh:
    """Read a food from a mesh file and repair it if that is safe.

    Args:
        path: .stl, .obj, .ply or .glb, closed and without self-intersections.
        unit: unit of the numbers in the file: "mm", "cm", "m" or "in"; None: metres.
        keep: which bodies of the file to keep, see `bodies.Keep`; one must remain.
        length: real length of the food's longest side [m], instead of a unit.

    Returns:
        A closed mesh in its frame F [m]: centroid at the origin, longest principal axis along x, second along y. Meshes
        of more than 5,000 faces are simplified; the surface moves by at most 1 % of the largest extent.

    Raises:
        InputError: the file cannot be used; the message is one line and suggests a remedy.
    """
    if unit is not None:
        one_of("unit", unit, list(UNITS))
    data = _checked_bytes(path)
    if _triangles(path, data, path.suffix.lower()) == 0:
        raise InputError(f"mesh {path} is empty: it has no triangles; export it again")
    scan = _read_in_child(path, data, path.suffix.lower(), keep)
    try:
        body = one_body(scan.bodies)
        longest = 0.0 if length is None else long_side(body.vertices)
        scale = checked_scale([float(np.ptp(body.vertices, axis=0).max())], unit, length, longest)
    except InputError as error:
        raise InputError(f"mesh {path} {error}") from None
    return upright(Mesh(body.vertices * scale, body.faces))


def upright(mesh: Mesh) -> Mesh:
    """A mesh with its centroid at the origin and its longest principal axes along x and y."""
    X_FC = canonical_frame(mesh)
    z_y_x = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # the longest axis of C is z
    rotated = mesh.moved(Pose(X_FC.rotation @ z_y_x, X_FC.position).inverse())
    return Mesh(rotated.vertices - rotated.centroid, rotated.faces)


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


def _triangles(path: Path, data: bytes, suffix: str) -> int:
    """The number of triangles that the file declares.

    Raises:
        InputError: the content is not what the suffix says, or there are too many.
    """
    try:
        triangles = declared_triangles(data, suffix)
    except InputError as error:
        raise InputError(f"mesh {path} {error}") from None
    if triangles > MAX_TRIANGLES:
        raise InputError(
            f"mesh {path} declares {triangles} triangles or more; at most {MAX_TRIANGLES} are read; simplify it"
        )
    return triangles


def _read_in_child(path: Path, data: bytes, suffix: str, keep: Keep) -> Scan:
    answer = run_parser("cutgrammar.geometry.mesh_io.parser_process", (suffix, keep), data, TIMEOUT)
    if answer.code is None:
        raise InputError(f"mesh {path} takes over {TIMEOUT:.0f} s to read; simplify it first")
    if answer.code == REFUSED:
        raise InputError(f"mesh {path} {answer.message}")
    if answer.has_died:
        raise InputError(f"mesh {path} needs more memory or time to read than a mesh should; export it again")
    if answer.code:
        raise InputError(f"mesh {path} cannot be parsed ({answer.message or 'no reason given'}); export it again")
    with np.load(io.BytesIO(answer.output), allow_pickle=False) as arrays:
        count = (len(arrays.files) - 1) // 2
        bodies = tuple(Mesh(arrays[f"vertices{i}"], arrays[f"faces{i}"]) for i in range(count))
        return Scan(path, bodies, tuple(map(str, arrays["notes"].tolist())))
