"""Hostile settings, studies, meshes and robot descriptions."""

import bz2
import gzip
import io
import json
import struct
import zipfile
from collections.abc import Iterator
from typing import Any

from hostile.cases import READ, Case, bytes_case
from hostile.documents import ESCAPE, _fifo, _folder, _link, _sparse

TOML = (
    ("nested lists", "[search]\nmax_rounds = " + "[" * 5000 + "]" * 5000, []),
    ("nested 900 deep", "[search]\nmax_rounds = " + "[" * 900 + "]" * 900, []),
    ("dotted names", "a" + ".a" * 100_000 + " = 1\n", []),
    ("dotted table", "[a" + ".a" * 30_000 + "]\n", []),
    ("an integer of 5,000 digits", "[search]\nmax_rounds = " + "9" * 5000, []),
    ("an integer of 400 digits", "[search]\nmax_rounds = " + "9" * 400, ["max_rounds"]),
    ("infinity", "[search]\nexploration = inf", ["exploration"]),
    ("NaN", "[search]\nexploration = nan", ["exploration"]),
    ("1e999", "[search]\nexploration = 1e999", ["exploration"]),
    ("a date", "[kinova]\nflange = 1979-05-27", ["flange"]),
    ("text for a number", '[search]\nmax_rounds = "5"', ["max_rounds"]),
    ("true for a number", "[search]\nmax_rounds = true", ["max_rounds"]),
    ("a fraction", "[search]\nmax_rounds = 1.5", ["max_rounds"]),
    ("hidden = 1000000000", "[features]\nhidden_size = 1000000000", ["hidden_size"]),
    ("10^12 points", "[features]\nn_points = 1000000000000", ["n_points"]),
    ("10^12 rollouts", "[search]\nmax_rounds = 1000000000000", ["max_rounds"]),
    ("10^9 searches", "[search]\nn_searches = 1000000000", ["n_searches"]),
    ("an image of 10^12 pixels", "[cameras]\nwidth = 1000000\nheight = 1000000", ["width"]),
    ("a blade of 10^300 mm", "[kinova]\nblade_length_mm = 1e300", ["blade_length_mm"]),
    ("an unknown name with escapes", '[search]\n"\\u001b[2J" = 1', []),
    ("a value with escapes", '[vision]\nbelief = "\\u001b[2J"', ["belief"]),
    ("a table for a value", "[search.max_rounds]\na = 1", ["max_rounds"]),
    ("a value for a table", "search = 1", ["search"]),
    ("unknown table", "[serach]\nx = 1", ["serach"]),
    ("control characters", "[search]\n# \x1b[2J\n", []),
    ("names twice", "[search]\nn_starts = 1\nn_starts = 2", []),
    ("a million gammas", "[induction]\ngammas = [" + "-1.0," * 1_000_000 + "]", []),
    ("text of 5 MB", '[kinova]\nflange = "' + "a" * 5_000_000 + '"', []),
    ("a flange with escapes", '[kinova]\nflange = "\\u001b[2J"', ["flange"]),
)
RAW = (("no UTF-8", b"\xff\xfe"), ("zeros", bytes(1000)), ("UTF-16", "[search]".encode("utf-16")))
STUDIES = (
    ("study is a list", "study = [1]", ["study"]),
    ("10^9 models", "[study]\nmodels = 1000000000", ["models"]),
    ("a name with ../", '[[variants]]\nname = "../../x"', ["name"]),
    ("a name with escapes", '[[variants]]\nname = "\\u001b[2J"', ["name"]),
    ("variants is a number", "variants = 5", ["variants"]),
    ("variants of numbers", "variants = [5]", ["variant"]),
    ("settings are a list", '[[variants]]\nname = "a"\nsettings = [1]', ["settings"]),
    ("settings of a number", '[[variants]]\nname = "a"\nsettings.search = 1', ["search"]),
    ("10^12 trials", "[collect]\ntrials = 1000000000000", ["trials"]),
    ("an unknown setup", '[collect]\nsetups = ["../x"]', ["setup"]),
    ("foods that are numbers", "[collect]\nfoods = [1]", ["foods"]),
    ("a world with ../", '[evaluate]\nworld = "../x"', ["world"]),
    ("split is text", 'split = "x"', ["split"]),
    ("a base table of a number", 'search = 5\n[[variants]]\nname = "a"', ["search"]),
    ("transfers of nothing", "[[transfers]]\n", ["name"]),
    ("10^9 test trials", '[[transfers]]\nname = "a"\ntest_trials = 1000000000000', ["test_trials"]),
    ("100,000 variants", "".join(f'[[variants]]\nname = "v{i}"\n' for i in range(20_000)), ["variants"]),
)


def text_cases() -> Iterator[Case]:
    """Settings and studies."""
    for reader in ("settings", "study"):
        file = f"{reader}.toml"
        for name, text, named in TOML:
            yield bytes_case(reader, file, name, text.encode(), named=[file, *named])
        for name, content in RAW:
            yield bytes_case(reader, file, name, content)
        yield Case(reader, f"{file}: a FIFO", lambda folder, file=file: _fifo(folder / file), [file])
        yield Case(reader, f"{file}: a folder", lambda folder, file=file: _folder(folder / file), [file])
        yield Case(reader, f"{file}: endless", lambda folder, file=file: _link(folder / file, "/dev/zero"), [file])
        yield Case(reader, f"{file}: 20 GB", lambda folder, file=file: _sparse(folder / file), [file])
    for name, text, named in STUDIES:
        yield bytes_case("study", "study.toml", name, text.encode(), named=["study.toml", *named])


def mesh_cases() -> Iterator[Case]:
    """Meshes."""

    def mesh(suffix: str, name: str, content: Any, **options: Any) -> Case:
        return bytes_case("mesh", f"box.{suffix}", name, content, command=f"{READ['mesh']} box.{suffix}", **options)

    for suffix in ("stl", "obj", "ply", "glb"):
        file = f"box.{suffix}"
        for name, content in (
            ("empty", b""),
            ("zeros", bytes(1000)),
            ("gzip", gzip.compress(bytes(10_000_000))),
            ("zip", _zipped()),
            ("bzip2", bz2.compress(bytes(10_000_000))),
            ("cut short", lambda old: old[: 2 * len(old) // 3]),
            ("escapes", ESCAPE.encode() * 10),
        ):
            yield mesh(suffix, name, content)
        yield Case(
            "mesh", f"{file}: a FIFO", lambda folder, file=file: _fifo(folder / file), [file], f"{READ['mesh']} {file}"
        )
        yield Case(
            "mesh",
            f"{file}: a folder",
            lambda folder, file=file: _folder(folder / file),
            [file],
            f"{READ['mesh']} {file}",
        )
        yield Case(
            "mesh",
            f"{file}: endless",
            lambda folder, file=file: _link(folder / file, "/dev/zero"),
            [file],
            f"{READ['mesh']} {file}",
        )
        yield Case(
            "mesh", f"{file}: 20 GB", lambda folder, file=file: _sparse(folder / file), [file], f"{READ['mesh']} {file}"
        )
    yield mesh("stl", "4 billion triangles", lambda old: old[:80] + b"\xff\xff\xff\xff" + old[84:])
    yield mesh("stl", "NaN", lambda old: old[:96] + struct.pack("<f", float("nan")) + old[100:])
    yield mesh("stl", "10^38 m", lambda old: old[:96] + struct.pack("<f", 3e38) + old[100:])
    yield mesh("obj", "vertex numbers of 5,000 digits", lambda old: old + b"f " + b"9" * 5000 + b" 1 2\n")
    yield mesh("obj", "a corner far beyond", lambda old: old + b"f 1 2 999999999\n")
    yield mesh("obj", "a corner 0", lambda old: old + b"f 0 1 2\n")
    yield mesh("obj", "1e999", lambda old: old + b"v 1e999 0 0\n", may_pass=True)
    yield mesh("obj", "a material elsewhere", lambda old: b"mtllib /etc/passwd\n" + old, may_pass=True)
    yield mesh("obj", "one face of a million corners", lambda old: old + b"f" + b" 1" * 1_000_000 + b"\n")
    yield mesh(
        "ply", "10^18 vertices", lambda old: old.replace(b"element vertex 8", b"element vertex 999999999999999999")
    )
    yield mesh(
        "ply",
        "vertices of 4,000 digits",
        lambda old: old.replace(b"element vertex 8", b"element vertex " + b"9" * 4000),
    )
    yield mesh(
        "ply",
        "10^5 properties",
        lambda old: old.replace(b"property float x", b"property float x" + b"\nproperty float q" * 3000),
    )
    yield mesh("ply", "an unknown type", lambda old: old.replace(b"property float x", b"property object x"))
    for name, change in (
        ("deep JSON", lambda _: "[" * 100_000 + "]" * 100_000),
        ("a count of 10^18", lambda tree: put_in(tree, ["accessors", 0, "count"], 10**18)),
        ("a negative offset", lambda tree: put_in(tree, ["bufferViews", 0, "byteOffset"], -5)),
        ("a count that is text", lambda tree: put_in(tree, ["accessors", 0, "count"], "x")),
        ("a file elsewhere", lambda tree: put_in(tree, ["buffers"], [{"uri": "/etc/passwd", "byteLength": 9}])),
        ("nodes in a circle", lambda tree: put_in(tree, ["nodes"], [{"children": [1]}, {"children": [0]}])),
        ("a node in itself", lambda tree: put_in(tree, ["nodes"], [{"children": [0], "mesh": 0}])),
        ("an unknown component type", lambda tree: put_in(tree, ["accessors", 0, "componentType"], 9)),
        ("a name with escapes", lambda tree: put_in(tree, ["meshes", 0, "name"], ESCAPE)),
        ("a view of others' bytes", lambda tree: put_in(tree, ["bufferViews", 0, "byteLength"], 10**9)),
        ("meshes are a number", lambda tree: put_in(tree, ["meshes"], 5)),
        ("a million nodes", lambda tree: put_in(tree, ["nodes"], [{"mesh": 0}] * 100_000)),
        ("draco with escapes", lambda tree: put_in(tree, ["extensionsUsed"], [f"draco{ESCAPE}"])),
    ):
        yield mesh(
            "glb",
            name,
            lambda old, change=change: _glb(old, change),
            may_pass="escapes" in name and "draco" not in name,
        )


def urdf_cases() -> Iterator[Case]:
    """Robot descriptions."""
    for name, content in (
        ("empty", b""),
        ("zeros", bytes(100)),
        ("deep", b"<robot>" + b"<a>" * 100_000 + b"</a>" * 100_000 + b"</robot>"),
        ("a million links", b"<robot>" + b"<link name='a'/>" * 200_000 + b"</robot>"),
        ("entities", b"<!DOCTYPE r [<!ENTITY a 'aa'>]><robot>&a;</robot>"),
        ("UTF-16 with entities", "<!DOCTYPE r [<!ENTITY a 'aa'>]><robot>&a;</robot>".encode("utf-16")),
        ("no robot", b"<html/>"),
        ("a name with escapes", lambda old: old.replace(b"<robot ", b"<robot x='&#27;' ", 1)),
        ("deep inside a link", lambda old: old.replace(b"</link>", b"<a>" * 20_000 + b"</a>" * 20_000 + b"</link>", 1)),
        ("NaN", lambda old: old.replace(b'xyz="0 0 ', b'xyz="nan 0 ', 1)),
        ("infinity", lambda old: old.replace(b'xyz="0 0 ', b'xyz="inf 0 ', 1)),
        ("1e308", lambda old: old.replace(b'xyz="0 0 ', b'xyz="1e308 0 ', 1)),
        ("1_000", lambda old: old.replace(b'xyz="0 0 ', b'xyz="1_000 0 ', 1)),
        ("a joint with escapes", lambda old: old.replace(b'<joint name="', b'<joint name="\xc2\x9b\xe2\x80\xae', 1)),
        ("a mass of 10^300", lambda old: _mass(old, b"1e300")),
        ("a mass of -1", lambda old: _mass(old, b"-1")),
        ("no joints", lambda old: old[: old.index(b"<joint")] + b"</robot>"),
        ("a circle", lambda old: old.replace(b'<parent link="base_link"', b'<parent link="flange"')),
    ):
        yield bytes_case("urdf", "arm.urdf", name, content, may_pass=name in ("a joint with escapes",))
    for name, spoil in (("a FIFO", _fifo), ("a folder", _folder), ("20 GB", _sparse)):
        yield Case("urdf", name, lambda folder, spoil=spoil: spoil(folder / "arm.urdf"), ["arm.urdf"])
    yield Case("urdf", "endless", lambda folder: _link(folder / "arm.urdf", "/dev/zero"), ["arm.urdf"])


def put_in(tree: Any, path: list[str | int], value: Any) -> Any:
    """The tree, with one value replaced."""
    from hostile.cases import put

    put(tree, path, value)
    return tree


def _glb(old: bytes, change: Any) -> bytes:
    length = struct.unpack_from("<I", old, 12)[0]
    changed = change(json.loads(old[20 : 20 + length]))
    text = (changed if isinstance(changed, str) else json.dumps(changed)).encode()
    text += b" " * (-len(text) % 4)
    rest = old[20 + length :]
    return struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest


def _mass(old: bytes, value: bytes) -> bytes:
    import re

    return re.sub(rb'<mass value="[^"]*"', b'<mass value="' + value + b'"', old, count=2)


def _zipped() -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a", bytes(10_000_000))
    return out.getvalue()
