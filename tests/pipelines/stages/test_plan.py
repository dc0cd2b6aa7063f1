import json

import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.fragment import Cloud, Mesh
from cutgrammar.geometry.mesh_io.files import write_mesh
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar_pipelines.cli.main import main

FAST = "[fitting]\nevaluations = 2000\n"


def box(size, at=(0.0, 0.0, 0.0)):
    made = trimesh.creation.box(size)
    return Mesh(made.vertices + np.array(at), made.faces)


def write_cloud(cloud, path, names=("nx", "ny", "nz")):
    rows = np.column_stack([cloud.points, cloud.normals]) if names else cloud.points
    header = ["ply", "format ascii 1.0", f"element vertex {len(rows)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", *names)] + ["end_header"]
    path.write_text("\n".join(header + [" ".join(f"{number:.9g}" for number in row) for row in rows]) + "\n")


def write_together(meshes, path):
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
    write_mesh(Mesh(vertices, faces), path)


@pytest.fixture
def fast(tmp_path):
    (tmp_path / "fast.toml").write_text(FAST)
    return ["--settings", str(tmp_path / "fast.toml")]


def planned(words, out):
    code = main(["plan", *map(str, words), "--out", str(out)])
    return code, json.loads((out / "plan.json").read_text())


@pytest.mark.slow
def test_a_whole_plan_for_touching_halves_in_one_file_has_planes_in_the_files_own_frame(tmp_path, fast, capsys):
    at = np.array([1500.0, 200.0, -900.0])  # millimetres, far from the origin, y up
    write_mesh(box((40, 100, 40), at), tmp_path / "whole.stl")
    thirds = [
        box((40, 30, 40), at - np.array([0, 35, 0])),
        box((40, 35, 40), at - np.array([0, 2.5, 0])),
        box((40, 35, 40), at + np.array([0, 32.5, 0])),
    ]
    write_together(thirds, tmp_path / "thirds.stl")
    words = ["--now", tmp_path / "whole.stl", "--goal", tmp_path / "thirds.stl", "--unit", "mm", "--up", "y", *fast]
    code, plan = planned(words, tmp_path / "out")
    assert code == 0
    assert plan["stuck"] is None
    assert plan["score"]["iou_strict"] > 0.7
    assert len(plan["cuts"]) == 2
    for cut in plan["cuts"]:
        assert abs(cut["normal"][1]) > 0.9
        assert abs(np.dot(cut["normal"], cut["centroid"]) + cut["offset"]) < 40
        assert cut["file"] == str(tmp_path / "whole.stl")
        # y of the file is z of the world, whose origin is below the middle of the fragment
        n, d = np.array(cut["world"]["normal"]), cut["world"]["offset"]
        assert n == pytest.approx(np.array(cut["normal"])[[0, 2, 1]] * [1, -1, 1])
        assert d == pytest.approx(1e-3 * (cut["offset"] + np.dot(cut["normal"], at - [0, 50, 0])))
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"plan.json", "plan.rrd", "plan.png", "plan-step-01.png", "plan-step-02.png"}
    assert "expected strict IoU" in capsys.readouterr().out


@pytest.mark.slow
def test_the_same_request_gives_the_same_plan_and_a_json_name_takes_the_other_files_beside_it(tmp_path, fast, capsys):
    write_mesh(box((0.1, 0.04, 0.04)), tmp_path / "whole.obj")
    write_together([box((0.05, 0.04, 0.04), (x, 0, 0)) for x in (-0.025, 0.025)], tmp_path / "goal.obj")
    words = ["plan", "--now", tmp_path / "whole.obj", "--goal", tmp_path / "goal.obj", *fast]
    for name in ("a.json", "b.json"):
        assert main([*map(str, words), "--out", str(tmp_path / name)]) == 0
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    for ending in (".rrd", ".png", "-step-01.png"):
        assert (tmp_path / f"a{ending}").stat().st_size > 1000
    capsys.readouterr()


@pytest.mark.slow
def test_a_goal_that_lies_elsewhere_is_moved_and_a_stated_length_gives_the_scale(tmp_path, fast, capsys):
    write_mesh(box((7, 2.5, 2)), tmp_path / "whole.stl")
    for name, x in (("left.stl", 300.0), ("right.stl", 304.0)):
        write_mesh(box((3.5, 2.5, 2), (x, 900.0, 0.0)), tmp_path / name)
    goal = ["--goal", tmp_path / "left.stl", tmp_path / "right.stl"]
    _, plan = planned(["--now", tmp_path / "whole.stl", *goal, "--length", "178mm", *fast], tmp_path / "out")
    assert plan["now"][0]["metres_per_number"] == pytest.approx(0.178 / 7)
    assert abs(plan["cuts"][0]["normal"][0]) > 0.98
    assert plan["cuts"][0]["offset"] == pytest.approx(0.0, abs=0.2)
    assert "was moved to them as a whole" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("names", [("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"), ()])
def test_clouds_get_a_whole_plan_too(tmp_path, fast, capsys, names):
    whole = sample_surface(box((0.12, 0.05, 0.03)), 1500)  # no two sides alike, so that its frames are unique
    write_cloud(Cloud(whole.points, -whole.normals), tmp_path / "whole.ply", names)
    for name, x in (("left.ply", -0.03), ("right.ply", 0.03)):
        write_cloud(sample_surface(box((0.06, 0.05, 0.03), (x, 0, 0)), 1500), tmp_path / name, names)
    goal = ["--goal", tmp_path / "left.ply", tmp_path / "right.ply"]
    code, plan = planned(["--now", tmp_path / "whole.ply", *goal, *fast], tmp_path / "out")
    assert code == 0
    assert abs(plan["cuts"][0]["normal"][0]) > 0.97
    assert plan["score"]["iou_strict"] > 0.85
    said = capsys.readouterr().out
    assert ("pointed inwards and were turned" if names else "normals were estimated") in said
    assert "a surface was made of 1500 points" in said


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--method", "grammar"], "plans with a trained model; give --model, or a method that needs none: guided"),
        (["--method", "replay"], "needs a demonstration"),
        (["--unit", "cm"], "would be 0.001 m long"),
        (["--unit", "m", "--length", "10cm"], "--unit and --length both say"),
        (["--length", "ten"], "is not a length with its unit"),
        (["--length", "9m"], "with the length 9 m"),
    ],
)
def test_what_cannot_be_planned_is_refused_with_a_reason(tmp_path, capsys, words, message):
    write_mesh(box((0.1, 0.04, 0.04)), tmp_path / "whole.obj")
    write_together([box((0.05, 0.04, 0.04), (x, 0, 0)) for x in (-0.025, 0.025)], tmp_path / "goal.obj")
    files = ["--now", str(tmp_path / "whole.obj"), "--goal", str(tmp_path / "goal.obj")]
    assert main(["plan", *files, *words]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("bodies", ["largest", "union"])
def test_one_body_a_file_is_refused_where_it_leaves_nothing_to_cut(tmp_path, capsys, bodies):
    write_mesh(box((0.1, 0.04, 0.04)), tmp_path / "whole.obj")
    write_together([box((0.05, 0.04, 0.04), (x, 0, 0)) for x in (-0.025, 0.025)], tmp_path / "goal.obj")
    files = ["--now", str(tmp_path / "whole.obj"), "--goal", str(tmp_path / "goal.obj")]
    assert main(["plan", *files, "--bodies", bodies]) == 2
    assert f"--bodies {bodies} leaves one fragment in every file, and so 1 in the goal" in capsys.readouterr().err


def test_goals_with_fewer_fragments_or_of_another_size_are_refused(tmp_path, capsys):
    write_mesh(box((0.1, 0.04, 0.04)), tmp_path / "whole.obj")
    write_together([box((0.05, 0.04, 0.04), (x, 0, 0)) for x in (-0.025, 0.025)], tmp_path / "goal.obj")
    write_together([box((0.02, 0.01, 0.01), (x, 0, 0)) for x in (-0.025, 0.025)], tmp_path / "small.obj")
    for now, goal, message in (
        ("goal", "whole", "the goal has 1 fragments, fewer than the 2 there are now"),
        ("whole", "small", "0.025 times the volume of the current ones"),
    ):
        words = ["plan", "--now", str(tmp_path / f"{now}.obj"), "--goal", str(tmp_path / f"{goal}.obj")]
        assert main(words) == 2
        assert message in capsys.readouterr().err


@pytest.mark.slow
def test_the_papers_method_plans_with_a_model(model_folder, tmp_path, capsys):
    write_mesh(box((0.1, 0.04, 0.04)), tmp_path / "whole.obj")
    write_together([box((0.05, 0.04, 0.04), (x, 0, 0)) for x in (-0.025, 0.025)], tmp_path / "goal.obj")
    words = ["--now", tmp_path / "whole.obj", "--goal", tmp_path / "goal.obj", "--model", model_folder]
    code, plan = planned([*words, "--method", "grammar"], tmp_path / "out")
    assert code == 0
    assert len(plan["cuts"]) == 1
    assert plan["model"] is not None
    capsys.readouterr()
