import bz2
import gzip
import io
import json
import lzma
import os
import re
import struct
import tarfile
import zipfile

import numpy as np
import pytest
import trimesh

from cutgrammar.errors import InputError
from cutgrammar.geometry.mesh_io import files as mesh_files
from cutgrammar.geometry.mesh_io.files import SUFFIXES, read_food, read_scan, write_mesh


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_food_survives_writing_and_reading_in_every_format(tmp_path, lump, suffix):
    path = tmp_path / f"lump{suffix}"
    write_mesh(lump, path)
    read = read_food(path)
    assert read.volume == pytest.approx(lump.volume, rel=1e-6)
    assert len(read.faces) == len(lump.faces)
    assert np.ptp(read.vertices, axis=0).argmax() == 0


@pytest.mark.slow
def test_a_text_stl_and_a_text_ply_in_millimetres_are_read(tmp_path, lump):
    whole = trimesh.Trimesh(lump.vertices * 1000, lump.faces, process=False)
    (tmp_path / "lump.stl").write_text(whole.export(file_type="stl_ascii"))
    (tmp_path / "lump.PLY").write_bytes(whole.export(file_type="ply", encoding="ascii"))
    for name in ("lump.stl", "lump.PLY"):
        assert read_food(tmp_path / name, "mm").volume == pytest.approx(lump.volume, rel=1e-5)


def test_a_mesh_of_implausible_size_is_refused_and_a_unit_is_suggested(tmp_path, lump):
    path = tmp_path / "lump.obj"
    write_mesh(type(lump)(lump.vertices * 1000, lump.faces), path)
    with pytest.raises(InputError, match=r"lump.obj would be .* m long, read in m; .*--unit mm would") as refusal:
        read_food(path)
    assert "\n" not in str(refusal.value)


def test_corners_of_an_obj_that_count_backwards_are_those_before_the_line(tmp_path):
    lines = []
    for x in (0.0, 0.05):
        block = trimesh.creation.box((0.04, 0.03, 0.02), trimesh.transformations.translation_matrix((x, 0, 0)))
        lines += [
            f"g block{x}",
            *("v " + " ".join(map(str, vertex)) for vertex in block.vertices),
            "vt 0 0",
            "vn 0 0 1",
        ]
        lines += ["f \\\n " + " ".join(f"{corner - 8}/-1/-1" for corner in face) + " # -" for face in block.faces]
    path = tmp_path / "blocks.obj"
    path.write_text("\n".join(lines))
    scan = read_scan(path)
    assert [body.volume for body in scan.bodies] == pytest.approx([2.4e-5, 2.4e-5])
    assert [body.centroid[0] for body in scan.bodies] == pytest.approx([0.0, 0.05], abs=1e-9)
    path.write_text("\n".join(["v 0 0 0", "f -1 -2 -3"]))
    with pytest.raises(InputError, match="a face with the corner -2 after 1 of them"):
        read_scan(path)


@pytest.mark.parametrize("kind", ["obj", "stl_ascii"])
def test_decimal_commas_are_named(tmp_path, kind):
    path = tmp_path / f"block.{kind[:3]}"
    path.write_text(trimesh.creation.box((0.04, 0.03, 0.02)).export(file_type=kind).replace(".", ","))
    with pytest.raises(
        InputError, match=r"has numbers with a decimal comma \(line \d+\); export it with decimal points"
    ):
        read_scan(path)


def test_reading_an_obj_opens_no_other_file(tmp_path, lump):
    path = tmp_path / "lump.obj"
    write_mesh(lump, path)
    os.mkfifo(tmp_path / "trap.mtl")  # opening it would block
    path.write_text("mtllib trap.mtl\nmtllib /etc/passwd\nusemtl a\n" + path.read_text())
    assert read_food(path).volume == pytest.approx(lump.volume, rel=1e-9)


def test_a_glb_whose_textures_lie_beside_it_is_read_without_them(tmp_path, lump):
    path = tmp_path / "lump.glb"
    write_mesh(lump, path)
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    tree = json.loads(data[20 : 20 + length])
    tree["images"] = [{"uri": "textures/skin.png"}]
    tree["textures"] = [{"source": 0}]
    tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    tree["meshes"][0]["primitives"][0]["material"] = 0
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    path.write_bytes(head + text + rest)
    assert read_food(path).volume == pytest.approx(lump.volume, rel=1e-5)


def test_a_mesh_that_takes_too_long_is_refused(tmp_path, lump, monkeypatch):
    monkeypatch.setattr(mesh_files, "TIMEOUT", 1e-3)
    write_mesh(lump, tmp_path / "lump.obj")
    with pytest.raises(InputError, match="lump.obj takes over 0 s to read"):
        read_food(tmp_path / "lump.obj")


def tar_of(data: bytes) -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w") as archive:
        entry = tarfile.TarInfo("a.stl")
        entry.size = len(data)
        archive.addfile(entry, io.BytesIO(data))
    return out.getvalue()


def zip_of(data: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.stl", data)
    return out.getvalue()


BOMB = b"\0" * 20_000_000


@pytest.mark.parametrize("suffix", [".stl", ".stl.bz2", ".ply"])
@pytest.mark.parametrize("pack", [bz2.compress, gzip.compress, lzma.compress, zip_of, tar_of])
def test_archives_and_decompression_bombs_are_refused_by_suffix_and_content(tmp_path, pack, suffix):
    path = tmp_path / f"bomb{suffix}"
    path.write_bytes(pack(BOMB if pack is bz2.compress else b"solid"))
    with pytest.raises(InputError, match="archive"):
        read_food(path)


@pytest.mark.parametrize("name", ["a.zip", "a.stl.gz", "a.tar", "a.7z", "a.tgz", "a.rar", "a.zst", "A.BZ2"])
def test_archives_are_refused_by_suffix_before_they_are_opened(tmp_path, name):
    with pytest.raises(InputError, match="archive by its suffix"):
        read_food(tmp_path / name)


def stl_declaring(count: int) -> bytes:
    return b"\0" * 80 + struct.pack("<I", count) + b"\0" * 50 * min(count, 10)


def ply_declaring(faces: int, vertices: int = 8) -> bytes:
    return (
        f"ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()


def glb_of(tree) -> bytes:
    text = (tree if isinstance(tree, str) else json.dumps(tree)).encode()
    return struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text


MESHES = {
    "accessors": [{"count": 3000, "bufferView": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
}


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.stl", b"", "is empty: it has no bytes"),
        ("a.stl", stl_declaring(0), "is empty: it has no triangles"),
        ("a.stl", stl_declaring(7)[:-20], "not a complete binary or text STL file"),
        ("a.stl", stl_declaring(4_000_000_000), "not a complete"),
        ("a.stl", b"solid a\nendsolid a\n", "is empty"),
        ("a.stl", b"solid a\n" + b"endfacet\n" * 200_001, "at most 200000 are read"),
        ("a.stl", b"<html>not found</html>", "not a complete binary or text STL"),
        ("a.obj", b"# nothing\n", "is empty"),
        ("a.obj", b"f 1 2 3 4\n" * 100_001, "declares 200002 triangles"),
        ("a.obj", b"v 0 0 0\n\0\0", "binary data"),
        ("a.ply", b"plymouth", "header of a PLY file"),
        ("a.ply", ply_declaring(10**9), "declares 1000000000 triangles"),
        ("a.ply", ply_declaring(1, 10**10), "at most 200000 are read"),
        ("a.ply", ply_declaring(0, 0), "is empty"),
        ("a.glb", b"glTFtorn", "is not a valid .glb file"),
        ("a.glb", glb_of({}), "is empty"),
        ("a.glb", glb_of("[" * 100_000), "is not a valid .glb file"),
        ("a.glb", glb_of([]), "is not a valid .glb file"),
        ("a.glb", glb_of({"extensionsUsed": ["KHR_draco_mesh_compression"]}), "is compressed"),
        ("a.glb", glb_of({"buffers": [{"uri": "../../secret.bin"}]}), "keeps its shape in other files"),
        ("a.glb", glb_of({"accessors": [{"count": 10**9}]}), "accessors without data"),
        ("a.glb", glb_of({**MESHES, "nodes": [{"mesh": 0}] * 300}), "declares 300000 triangles"),
        ("a.glb", glb_of({**MESHES, "nodes": [{"children": [1, 1]}, {"mesh": 0}]}), "several parents"),
        ("a.txt", b"hello", "known: .stl, .obj, .ply, .glb"),
        ("a", b"hello", "known: .stl, .obj, .ply, .glb"),
    ],
)
def test_damaged_empty_oversized_and_foreign_files_are_refused_before_parsing(
    tmp_path, monkeypatch, name, content, message
):
    monkeypatch.setattr(mesh_files, "_read_in_child", lambda *_: pytest.fail("it was parsed"))
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError) as refusal:
        read_food(path)
    assert re.search(message, str(refusal.value)), refusal.value
    assert str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_missing_files_folders_pipes_and_oversized_files_are_refused(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="does not exist"):
        read_food(tmp_path / "none.stl")
    (tmp_path / "folder.stl").mkdir()
    os.mkfifo(tmp_path / "pipe.stl")
    for name in ("folder.stl", "pipe.stl"):
        with pytest.raises(InputError, match="is not a file"):
            read_food(tmp_path / name)
    with (tmp_path / "vast.stl").open("wb") as file:
        file.truncate(10**12)
    with pytest.raises(InputError, match="is too large: over 50 MB"):
        read_food(tmp_path / "vast.stl")


def test_an_unknown_unit_or_suffix_is_refused_and_the_known_ones_are_named(tmp_path, lump):
    with pytest.raises(InputError, match="unit 'inch' is unknown; known: mm, cm, m, in"):
        read_food(tmp_path / "a.stl", "inch")
    with pytest.raises(InputError, match="known: .stl, .obj, .ply, .glb"):
        write_mesh(lump, tmp_path / "a.3mf")


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_damaged_file_gives_a_food_or_a_one_line_refusal(tmp_path, lump, suffix):
    whole = tmp_path / f"whole{suffix}"
    write_mesh(lump, whole)
    data = whole.read_bytes()
    rng = np.random.default_rng(0)
    for attempt in range(4):
        torn = bytearray(data)
        if attempt % 2:
            torn = torn[: rng.integers(90, len(data))]
        else:
            for at in rng.integers(0, len(data), size=20):
                torn[at] = rng.integers(256)
        path = tmp_path / f"torn{attempt}{suffix}"
        path.write_bytes(torn)
        try:
            assert read_food(path).volume > 0
        except InputError as refusal:
            assert "\n" not in str(refusal)  # noqa: PT017
