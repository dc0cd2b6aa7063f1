import json

import numpy as np
import pytest
import trimesh

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Cloud, Mesh
from cutgrammar.geometry.mesh_io.files import read_scan, write_mesh
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar_pipelines.cli.main import main


def write_cloud(cloud, path):
    rows = np.column_stack([cloud.points, cloud.normals])
    header = ["ply", "format ascii 1.0", f"element vertex {len(rows)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")] + ["end_header"]
    path.write_text("\n".join(header + [" ".join(f"{number:.9g}" for number in row) for row in rows]) + "\n")


def test_a_scan_stays_where_it_lies(lump, random_pose, tmp_path):
    there = lump.moved(random_pose())
    write_mesh(there, tmp_path / "a.obj")
    fragment = read_scan(tmp_path / "a.obj")
    assert np.abs(fragment.p_WC - there.centroid).max() < 1e-9
    assert fragment.mesh.volume == pytest.approx(there.volume, rel=1e-9)


def test_a_cloud_with_normals_is_read_in_its_unit(lump, tmp_path):
    cloud = sample_surface(lump, 200)
    write_cloud(Cloud(cloud.points * 1e3 + 100, cloud.normals), tmp_path / "a.ply")
    fragment = read_scan(tmp_path / "a.ply", "mm")
    assert isinstance(fragment.shape, Cloud)
    seen = fragment.X_WF.apply(fragment.shape.points)
    assert np.abs(seen - (cloud.points + 0.1)).max() < 1e-6


def test_a_cloud_without_normals_is_refused(tmp_path, capsys):
    trimesh.PointCloud(np.random.default_rng(0).normal(size=(100, 3)) * 0.01).export(tmp_path / "a.ply")
    code = main(["plan", "--model", str(tmp_path), "--now", str(tmp_path / "a.ply"), "--goal", str(tmp_path / "a.ply")])
    assert code == 2
    capsys.readouterr()
    with pytest.raises(ValueError, match="without normals"):
        read_scan(tmp_path / "a.ply")


def test_a_cloud_in_one_plane_is_refused(lump, tmp_path):
    cloud = sample_surface(lump, 200)
    write_cloud(Cloud(cloud.points * np.array([1.0, 1.0, 0.0]), cloud.normals), tmp_path / "a.ply")
    with pytest.raises(InputError, match="is flat: its points are coplanar"):
        read_scan(tmp_path / "a.ply")


@pytest.mark.slow
def test_plans_lead_from_meshes_to_a_goal(model_folder, tmp_path, capsys):
    whole = trimesh.creation.box((0.1, 0.04, 0.04))
    half = trimesh.creation.box((0.05, 0.04, 0.04))
    write_mesh(Mesh(whole.vertices, whole.faces), tmp_path / "whole.stl")
    for name, x in (("left.stl", -0.025), ("right.stl", 0.025)):
        write_mesh(Mesh(half.vertices + np.array([x, 0, 0]), half.faces), tmp_path / name)
    words = [
        "plan",
        "--model",
        str(model_folder),
        "--now",
        str(tmp_path / "whole.stl"),
        "--out",
        str(tmp_path / "p.json"),
    ]
    goal = ["--goal", str(tmp_path / "left.stl"), str(tmp_path / "right.stl")]
    assert main([*words, *goal]) == 0
    first = json.loads((tmp_path / "p.json").read_text())
    assert len(first["cuts"]) == 1
    assert np.linalg.norm(first["cuts"][0]["normal"]) == pytest.approx(1)
    assert main([*words, *goal]) == 0
    assert json.loads((tmp_path / "p.json").read_text()) == first
    capsys.readouterr()
    backwards = ["plan", "--model", str(model_folder), "--now", *goal[1:], "--goal", str(tmp_path / "whole.stl")]
    assert main(backwards) == 2
    assert "fewer than the 2 there are now" in capsys.readouterr().err
