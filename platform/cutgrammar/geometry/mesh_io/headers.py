"""The size of a mesh file's content according to its headers, read before parsing."""

import re
import struct
from typing import Any

from cutgrammar.errors import InputError
from cutgrammar.untrusted import one_line, parse_json

MAGIC = {
    b"PK\x03\x04": "zip",
    b"PK\x05\x06": "zip",
    b"\x1f\x8b": "gzip",
    b"\x1f\x9d": "compress",
    b"BZh": "bzip2",
    b"\xfd7zXZ\x00": "xz",
    b"\x5d\x00\x00": "lzma",
    b"7z\xbc\xaf\x27\x1c": "7z",
    b"Rar!": "rar",
    b"\x28\xb5\x2f\xfd": "zstd",
    b"\x04\x22\x4d\x18": "lz4",
}
"""The first bytes of archives."""


DECIMAL_COMMA = re.compile(rb"^[ \t]*(?:v|vertex)[ \t]+[+-]?\d+,\d", re.MULTILINE)
"""A vertex as programs write it on machines whose language has a decimal comma."""


CORNER_0 = re.compile(rb"^[ \t]*f[ \t](?:[^#\n]*[ \t])?0+(?=[/ \t\r\n]|\Z)", re.MULTILINE)
"""A face of an OBJ file with a corner that there is not."""


def archive_kind(data: bytes) -> str | None:
    """The kind of archive according to its first bytes, or None."""
    if data[257:262] == b"ustar":
        return "tar"
    return next((kind for magic, kind in MAGIC.items() if data.startswith(magic)), None)


def declared_triangles(data: bytes, suffix: str) -> int:
    """An approximate upper bound of the number of triangles that parsing a file will give.

    Args:
        data: all bytes of the file.
        suffix: ".stl", ".obj", ".ply" or ".glb".

    Raises:
        InputError: the content does not match the suffix, is compressed, or keeps its shape in other files.
    """
    try:
        return {".stl": _stl, ".obj": _obj, ".ply": _ply, ".glb": _glb}[suffix](data)
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, RecursionError, struct.error) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"is not a valid {suffix} file ({type(error).__name__}: {one_line(str(error))}); export it again"
        ) from None


def _stl(data: bytes) -> int:
    if len(data) >= 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        return int.from_bytes(data[80:84], "little")
    if data.lstrip()[:5].lower() == b"solid":
        _refuse_decimal_commas(data)
        return data.lower().count(b"endfacet")
    raise InputError("is not a complete binary or text STL file; export it again")


def _obj(data: bytes) -> int:
    if b"\x00" in data:
        raise InputError("contains binary data, but OBJ is text; export it again")
    _refuse_decimal_commas(data)
    if found := CORNER_0.search(data):
        line = data[: found.end()].count(b"\n") + 1
        raise InputError(f"has a face with the corner 0 (line {line}), but corners count from 1; export it again")
    fans = sum(max(len(line.split()) - 3, 0) for line in re.findall(rb"^[ \t]*f[ \t].*$", data, re.MULTILINE))
    return max(fans, len(re.findall(rb"^[ \t]*v[ \t]", data, re.MULTILINE)) // 3)


def _refuse_decimal_commas(data: bytes) -> None:
    if found := DECIMAL_COMMA.search(data):
        line = data[: found.end()].count(b"\n") + 1
        raise InputError(f"has numbers with a decimal comma (line {line}); export it with decimal points")


def _ply(data: bytes) -> int:
    head, ended, _ = data[:65536].partition(b"end_header")
    if not head.startswith(b"ply") or not ended:
        raise InputError("does not start with the header of a PLY file; export it again")
    counts = re.findall(r"^element\s+(\S+)\s+(\d+)\s*$", head.decode("ascii", "replace"), re.MULTILINE)
    sizes = {name: int(count) for name, count in counts}
    return max(sizes.get("face", 0), max(sizes.values(), default=0) // 3)


def _glb(data: bytes) -> int:
    magic, version, _, length, kind = struct.unpack_from("<4sIIII", data)
    if magic != b"glTF" or version != 2 or kind != 0x4E4F534A or 20 + length > len(data):
        raise InputError("is not a binary glTF 2 file; export it again")
    tree = parse_json(data[20 : 20 + length])
    compressed = [name for name in tree.get("extensionsUsed", []) if "draco" in name or "meshopt" in name]
    if compressed:
        raise InputError(f"is compressed ({compressed[0]}); export it without compression")
    if any("uri" in item for item in tree.get("buffers", [])):  # textures, which may lie beside it, are never read
        raise InputError("keeps its shape in other files or embeds it as text; export it as one binary file")
    accessors = tree.get("accessors", [])
    if any("sparse" in item or "bufferView" not in item for item in accessors):
        raise InputError("has accessors without data (sparse accessors); export it again")
    max_count = max((int(item["count"]) for item in accessors), default=0)
    return max(max_count // 3, _instantiated(tree, [_mesh_size(mesh, accessors) for mesh in tree.get("meshes", [])]))


def _mesh_size(mesh: Any, accessors: Any) -> int:
    corners = [accessors[p["indices"] if "indices" in p else p["attributes"]["POSITION"]] for p in mesh["primitives"]]
    return sum(int(accessor["count"]) for accessor in corners) // 3


def _instantiated(tree: Any, sizes: list[int]) -> int:
    """Total number of triangles of all nodes; a mesh may be instantiated several times."""
    nodes = tree.get("nodes", [])
    children = [child for node in nodes for child in node.get("children", [])]
    if len(children) != len(set(children)):
        raise InputError("has nodes with several parents; export it again")
    inner = set(children)
    pending, reached = [i for i in range(len(nodes)) if i not in inner], 0
    while pending:
        pending += nodes[pending.pop()].get("children", [])
        reached += 1
    if reached < len(nodes):
        raise InputError("has nodes that are inside themselves; export it again")
    return sum(sizes[node["mesh"]] for node in nodes if "mesh" in node)


def counted_from_the_start(data: bytes) -> bytes:
    """An OBJ file whose faces name their corners by numbers from 1.

    A negative number counts backwards from the last corner before that line; trimesh counts from the end of the file.

    Raises:
        InputError: a number is 0, or points before the first corner.
    """
    data = re.sub(rb"\\\r?\n", b" ", data)  # a backslash continues a line
    if not re.search(rb"^[ \t]*f[ \t][^#\n]*-", data, re.MULTILINE):
        return data
    counts = {b"v": 0, b"vt": 0, b"vn": 0}
    lines = data.splitlines()
    for number, line in enumerate(lines):
        words = line.partition(b"#")[0].split()
        if words and words[0] in counts:
            counts[words[0]] += 1
        elif words and words[0] == b"f":
            lines[number] = b" ".join([b"f", *(_counted(word, tuple(counts.values())) for word in words[1:])])
    return b"\n".join(lines)


def _counted(corner: bytes, counts: tuple[int, ...]) -> bytes:
    """A corner v, v/vt or v/vt/vn of a face."""
    found = []
    for text, count in zip(corner.split(b"/"), counts, strict=False):
        index = int(text or 1)
        if index == 0 or index < -count:
            raise InputError(f"has a face with the corner {index} after {count} of them; export it again")
        found.append(str(index + count + 1 if index < 0 else index).encode() if text else b"")
    return b"/".join(found)
