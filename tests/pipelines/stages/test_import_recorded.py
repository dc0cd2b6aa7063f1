"""Demonstrations as files: what is exported and imported again is the same; what contradicts itself is refused."""

import json
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.mesh_io.files import write_mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.recorded_files import read_recorded
from cutgrammar.storage.split import read_split
from cutgrammar_pipelines.cli.main import main

GUIDE = Path(__file__).parents[3] / "docs" / "howto" / "import.md"
MM = 1000.0


def pose_of(X_WF):
    seven = X_WF.to_vector()
    return {"position": (MM * seven[:3]).tolist(), "quaternion": seven[3:].tolist()}


def export(demonstration, folder, name, suffix=None, products_of=()):
    """Write a demonstration in millimetres; meshes of the products of the cuts `products_of` too, as `suffix`."""
    (folder / "meshes").mkdir(parents=True, exist_ok=True)

    def mesh_of(fragment, ending):
        file = f"meshes/{name}-{fragment}{ending}"
        mesh = demonstration.fragments[fragment].mesh
        write_mesh(Mesh(MM * mesh.vertices, mesh.faces), folder / file)
        return file

    def product_of(fragment, cut):
        made = {"name": f"f{fragment}", "category": demonstration.fragments[fragment].category}
        if cut.step in products_of:
            made["mesh"] = mesh_of(fragment, suffix)
            made["pose"] = pose_of(demonstration.poses[cut.step, fragment])
        return {key: value for key, value in made.items() if value is not None}

    recorded = {
        "format": "cutgrammar demonstration",
        "version": 1,
        "unit": "mm",
        "categories": list(demonstration.categories),
        "objects": [
            {
                "name": f"f{i}",
                "food": food,
                "mesh": mesh_of(i, ".obj"),
                "pose": pose_of(demonstration.poses[0, i]),
            }
            for i, food in enumerate(demonstration.foods)
        ],
        "cuts": [
            {
                "fragment": f"f{cut.fragment}",
                "plane": {"normal": cut.plane_W.normal.tolist(), "offset": MM * cut.plane_W.offset},
                "products": [product_of(i, cut) for i in cut.products],
            }
            for cut in demonstration.cuts
        ],
    }
    write(folder / f"{name}.json", recorded)
    return recorded


def write(file, value):
    file.write_text(json.dumps(value))


def imported(folder, out, *words):
    assert main(["import", str(folder), "--out", str(out), *words, "--quiet"]) == 0
    return DataSet.open(out)


def assert_same_geometry(one, other):
    assert (one.setup, one.foods, one.categories) == (other.setup, other.foods, other.categories)
    assert [(f.parent, f.step, f.category) for f in one.fragments] == [
        (f.parent, f.step, f.category) for f in other.fragments
    ]
    assert [(cut.step, cut.fragment, cut.products) for cut in one.cuts] == [
        (cut.step, cut.fragment, cut.products) for cut in other.cuts
    ]
    assert one.poses.keys() == other.poses.keys()
    for key in one.poses:
        a, b = (d.fragment_at(*key) for d in (one, other))
        assert a.p_WC == pytest.approx(b.p_WC, abs=1e-6)
        assert a.mesh.volume == pytest.approx(b.mesh.volume, rel=1e-5)
        corners = [f.X_WF.apply(f.mesh.vertices) for f in (a, b)]
        assert np.abs(np.ptp(corners[0], axis=0) - np.ptp(corners[1], axis=0)).max() < 1e-6
    for a, b in zip(one.cuts, other.cuts, strict=True):
        assert a.plane_W.to_vector() == pytest.approx(b.plane_W.to_vector(), abs=1e-9)
        assert np.abs(a.plane_C.to_vector()) == pytest.approx(np.abs(b.plane_C.to_vector()), abs=1e-5)


@pytest.fixture(scope="module")
def scripted(data_folder):
    data = DataSet.open(data_folder)
    fewest = {trial.setup: trial for trial in sorted(data.trials, key=lambda one: -one.cuts) if trial.cuts >= 3}
    return data.demonstration(fewest["N1M1"].trial), data.demonstration(fewest["N2M3"].trial)


@pytest.fixture(scope="module")
def folder(scripted, tmp_path_factory):
    """Two demonstrations: of the first, cut 1 has meshes of its products."""
    made = tmp_path_factory.mktemp("recorded")
    for number, demonstration in enumerate(scripted):
        export(demonstration, made, f"d{number}", ".obj", products_of=(1,) if number == 0 else ())
    return made


@pytest.fixture(scope="module")
def data(folder, tmp_path_factory):
    return imported(folder, tmp_path_factory.mktemp("imported") / "data")


def test_what_was_exported_comes_back(scripted, data):
    assert [trial.trial for trial in data.trials] == [0, 1]
    for number, demonstration in enumerate(scripted):
        again = data.demonstration(number)
        assert_same_geometry(again, demonstration)
        assert again.demonstrator == "imported"
    assert data.foods == {food: "imported" for one in scripted for food in one.foods}


def test_the_same_files_give_the_same_bytes_and_are_imported_once(folder, data, tmp_path, capsys):
    again = imported(folder, tmp_path / "data")
    assert again.digest == data.digest
    assert main(["import", str(folder), "--out", str(tmp_path / "data")]) == 0
    assert "already holds these demonstrations: 2 trials; nothing to do" in capsys.readouterr().out
    other = shutil.copytree(folder, tmp_path / "other")
    (other / "d1.json").unlink()
    assert main(["import", str(other), "--out", str(tmp_path / "data")]) == 2
    assert "holds another data set (2 trials); choose another --out" in capsys.readouterr().err


def test_it_is_shown_split_and_merged_as_any_other(data, data_folder, tmp_path, capsys):
    own = shutil.copytree(data.path, tmp_path / "own")
    assert main(["split", str(own), "--out", str(own)]) == 0
    assert main(["split", str(data_folder), str(own), "--out", str(tmp_path / "both")]) == 0
    both = DataSet.open(tmp_path / "both")
    assert len(both.trials) == len(DataSet.open(data_folder).trials) + 2
    assert_same_geometry(both.demonstration(both.trials[-1].trial), data.demonstration(1))
    assert read_split(both, "paper").train
    assert main(["show", str(own)]) == 0
    assert "2 trials, foods" in capsys.readouterr().out


@pytest.mark.slow
def test_a_model_is_trained_on_imported_demonstrations(data_folder, quick_settings, tmp_path):
    from cutgrammar_pipelines.config import EvaluateConfig, TrainConfig
    from cutgrammar_pipelines.stages.evaluate import evaluate
    from cutgrammar_pipelines.stages.train import train

    source = DataSet.open(data_folder)
    for trial in source.trials:
        export(source.demonstration(trial.trial), tmp_path / "recorded", f"d{trial.trial:03}")
    data = imported(tmp_path / "recorded", tmp_path / "data")
    assert len(data.trials) == len(source.trials)
    assert main(["split", str(data.path), "--out", str(data.path)]) == 0
    trained = train(TrainConfig(data=data.path, out=tmp_path / "model", settings=quick_settings))
    config = EvaluateConfig(
        data=data.path,
        model=trained.path,
        out=tmp_path / "run",
        methods=["grammar", "replay"],
        world="bench",
        trials=1,
        workers=0,
        settings=quick_settings,
    )
    assert evaluate(config).complete


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".stl", ".ply", ".glb"])
def test_products_are_read_from_every_format(suffix, scripted, tmp_path):
    cuts = range(1, len(scripted[0].cuts) + 1)
    export(scripted[0], tmp_path / "recorded", "d", suffix, products_of=cuts)
    again = imported(tmp_path / "recorded", tmp_path / "data").demonstration(0)
    for a, b in zip(again.goal, scripted[0].goal, strict=True):  # these formats store seven digits
        assert a.p_WC == pytest.approx(b.p_WC, abs=1e-5)
        assert a.mesh.volume == pytest.approx(b.mesh.volume, rel=1e-3)


def test_poses_follow_what_was_moved_and_all_is_brought_onto_the_board(scripted, folder, tmp_path, capsys):
    one, far = scripted[0], np.array([1.0, -2.0, 0.8])
    recorded = json.loads((folder / "d0.json").read_text())
    for cut, made in zip(recorded["cuts"], one.cuts, strict=True):
        cut["plane"]["offset"] = MM * (made.plane_W.offset - float(made.plane_W.normal @ far))
        for product in cut["products"]:
            product.pop("mesh", None), product.pop("pose", None)
    X_WF = one.poses[0, 0]
    recorded["objects"][0]["pose"] = pose_of(Pose(X_WF.rotation, X_WF.position + far))
    last = len(one.cuts)
    bystander = next(i for i in one.alive(last) if i not in one.cuts[-1].products)
    aside = Pose(X_WF.rotation, X_WF.position + far + [0.0, 0.1, 0.0])
    recorded["cuts"][-1]["poses"] = {f"f{bystander}": pose_of(aside)}
    write(tmp_path / "d.json", recorded)
    shutil.copytree(folder / "meshes", tmp_path / "meshes")
    assert main(["import", str(tmp_path), "--out", str(tmp_path / "data")]) == 0
    assert re.search(r"d\.json: moved as a whole by \(.*\) mm onto the middle of the board", capsys.readouterr().err)
    again = DataSet.open(tmp_path / "data").demonstration(0)
    corners = again.start[0].X_WF.apply(again.start[0].mesh.vertices)
    assert corners[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    assert (corners.min(axis=0) + corners.max(axis=0))[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
    before, after = (again.poses[step, bystander].position for step in (last - 1, last))
    assert after - before == pytest.approx([0.0, 0.1, 0.0], abs=1e-9)
    for a, b in zip(again.cuts, one.cuts, strict=True):
        assert np.abs(a.plane_C.to_vector()) == pytest.approx(np.abs(b.plane_C.to_vector()), abs=1e-5)


def test_the_example_of_the_guide_follows_the_schema(tmp_path):
    text = re.search(r"```json\n(.*?)```", GUIDE.read_text(), re.DOTALL)[1]
    (tmp_path / "carrot-01.json").write_text(text)
    recorded = read_recorded(tmp_path / "carrot-01.json")
    assert [cut.fragment for cut in recorded.cuts] == ["carrot", "rest"]


def set_to(*path):
    *keys, last, value = path

    def change(recorded):
        for key in keys:
            recorded = recorded[key]
        recorded[last] = value

    return change


def without(*path):
    *keys, last = path

    def change(recorded):
        for key in keys:
            recorded = recorded[key]
        del recorded[last]

    return change


def swapped(recorded):
    first, second = recorded["cuts"][0]["products"][:2]
    first["mesh"] = second["mesh"]
    first.pop("pose")


def shifted(recorded):
    recorded["cuts"][0]["plane"]["offset"] += 6.0


def shifted_in_place(recorded):
    shifted(recorded)
    for product in recorded["cuts"][0]["products"]:
        product.pop("pose")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (set_to("version", 2), "version, 2: input should be 1"),
        (set_to("format", "csv"), "format, 'csv': "),
        (set_to("unit", "inch"), "unit, 'inch': input should be 'mm', 'cm', 'm' or 'in'"),
        (set_to("unit", "m"), r"object f0 is [0-9.e+]+ m long, in m; foods are .* in mm it would be"),
        (without("unit"), "unit: is missing"),
        (set_to("colour", "red"), "colour, 'red': is unknown"),
        (set_to("categories", ["dice"]), "category 1, 'dice': input should be 'chunks'"),
        (set_to("categories", ["chunks", "chunks"]), "each category stands once"),
        (set_to("categories", ["chunks", "slices", "cubes"]), "1 objects cut into 3 categories are the setup N1M3"),
        (set_to("objects", []), "objects: tuple should have at least 1 item"),
        (set_to("objects", 0, "mesh", "../secret.stl"), "object f0: the mesh '../secret.stl' is outside"),
        (set_to("objects", 0, "mesh", "none.stl"), "object f0: mesh .*none.stl does not exist"),
        (set_to("objects", 0, "mesh", "d0.json"), "object f0: mesh .*d0.json has the suffix '.json'; known"),
        (set_to("objects", 0, "mesh", "torn.stl"), "object f0: mesh .*torn.stl "),
        (set_to("objects", 0, "mesh", "open.obj"), "object f0: mesh .*open.obj .* open|edges"),
        (set_to("objects", 0, "name", "\x1b[31m"), "object 1, name, .*: is not made of letters"),
        (set_to("objects", 0, "pose", "position", [0, 0]), "object 1, pose, position"),
        (set_to("objects", 0, "pose", "position", [0, 0, "1"]), "object 1, pose, position 3, '1'"),
        (set_to("objects", 0, "pose", "position", [0, 0, 1e9]), "object 1, pose, position 3"),
        (set_to("objects", 0, "pose", "quaternion", [1, 1, 0, 0]), "quaternion of object f0 has length 1.41"),
        (set_to("cuts", []), "cuts: tuple should have at least 1 item"),
        (set_to("cuts", 1, "fragment", "f0"), "cut 2: its fragment 'f0' was cut before; those that exist: f1, "),
        (set_to("cuts", 1, "fragment", "f99"), "cut 2: its fragment 'f99' is unknown; those that exist"),
        (set_to("cuts", 0, "plane", "offset", 500.0), "cut 1: the plane misses the fragment 'f0', which lies .* mm"),
        (set_to("cuts", 0, "plane", "normal", [1, 1, 0]), "cut 1: the normal of its plane has length 1.41"),
        (set_to("cuts", 0, "plane", "normal", [0, 0, 0]), "cut 1: the normal of its plane has length 0"),
        (without("cuts", 1, "plane"), "cut 2, plane: is missing"),
        (without("cuts", 0, "products", 1), "cut 1, products: tuple should have at least 2 items"),
        (set_to("cuts", 0, "products", 1, "name", "f1"), "cut 1: the name 'f1' stands twice"),
        (without("cuts", 0, "products", 1, "mesh"), "cut 1: some of its products have a mesh and some have none"),
        (set_to("cuts", 0, "products", 0, "category", "dice"), "cut 1, product 1, category, 'dice'"),
        (set_to("cuts", 1, "poses", {"f0": {"position": [0, 0, 0]}}), "cut 2: the pose of 'f0' has no fragment"),
        (shifted, "cut 1: its plane makes fragments of 'f0' with .* ml; the meshes of its products have .* ml"),
        (swapped, "cut 1: .* and '.*' has the volume, the proportions or the place of none that is left"),
        (shifted_in_place, "cut 1: product '.*' reaches .* mm through the plane"),
    ],
)
def test_what_contradicts_itself_is_refused_with_file_and_cut(change, message, folder, tmp_path, capsys):
    recorded = json.loads((folder / "d0.json").read_text())
    change(recorded)
    shutil.copytree(folder, tmp_path / "recorded")
    write(tmp_path / "recorded" / "d0.json", recorded)
    (tmp_path / "recorded" / "torn.stl").write_bytes(b"solid a\nfacet normal 0 0")
    (tmp_path / "recorded" / "open.obj").write_text("v 0 0 0\nv 50 0 0\nv 0 50 0\nv 0 0 50\nf 1 2 3\nf 1 2 4\n")
    assert main(["import", str(tmp_path / "recorded"), "--out", str(tmp_path / "data")]) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith(f"cutgrammar import: {tmp_path / 'recorded' / 'd0.json'}")
    assert re.search(message, line), line
    assert line.isprintable()
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is not JSON: EOF while parsing"),
        (b'{"format": "cutgrammar demonstra', "is not JSON: EOF while parsing"),
        (b"[" * 100_000, "is not JSON: recursion limit"),
        (b"[1, 2]", "the file: "),
        (b'{"version": NaN}', "is not JSON|is missing|version"),
        (b'{"unit": "\xff"}', "is not JSON"),
        (b" " * 6_000_000, "is too large: more than 5 MB"),
    ],
)
def test_torn_and_foreign_files_are_refused(content, message, folder, tmp_path, capsys):
    shutil.copytree(folder, tmp_path / "recorded")
    (tmp_path / "recorded" / "d1.json").write_bytes(content)
    assert main(["import", str(tmp_path / "recorded"), "--out", str(tmp_path / "data")]) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith(f"cutgrammar import: {tmp_path / 'recorded' / 'd1.json'}")
    assert re.search(message, line), line


def test_other_folders_are_refused(tmp_path, capsys):
    for place, message in ((tmp_path / "none", "is not a folder"), (tmp_path, "has no JSON file")):
        assert main(["import", str(place), "--out", str(tmp_path / "data")]) == 2
        assert message in capsys.readouterr().err
    os.mkfifo(tmp_path / "d.json")
    assert main(["import", str(tmp_path), "--out", str(tmp_path / "data")]) == 2
    assert "d.json is a named pipe" in capsys.readouterr().err


def test_a_link_out_of_the_folder_is_refused(folder, tmp_path, capsys):
    shutil.copytree(folder, tmp_path / "recorded")
    mesh = json.loads((folder / "d0.json").read_text())["objects"][0]["mesh"]
    (tmp_path / "recorded" / mesh).unlink()
    (tmp_path / "recorded" / mesh).symlink_to(folder / mesh)
    assert main(["import", str(tmp_path / "recorded"), "--out", str(tmp_path / "data")]) == 2
    assert "is outside" in capsys.readouterr().err
