"""Good files of every kind, made with the commands themselves; hostile ones are made of copies of them."""

import hashlib
import json
import shutil
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from cutgrammar.atomic_files import json_bytes
from cutgrammar.geometry.plane import Plane
from cutgrammar.storage.ledger import read_planned
from cutgrammar.storage.part_footers import trust_footer
from cutgrammar.storage.ratings import Rating, RatingStore
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar.storage.tables import ALL_SCHEMAS
from cutgrammar.trials.rating_plan import RESULT
from cutgrammar.trials.trajectory import CutTrajectory, Limits, Trajectory, trajectory_to_json
from cutgrammar_dashboards.demonstrating.journal import Journal
from cutgrammar_pipelines.cli.main import main

RATINGS = "run/ratings.sqlite"
JOURNAL = "open.journal"
RECORDINGS = {"random": "random.rrd", "largest": "largest.rrd"}
"""Recordings of one trial by two methods; they are no part of the run."""
RECORDED = "recorded"
"""Folder of demonstrations for `cutgrammar import`."""
SETTINGS = """
[features]
epochs = 1
n_points = 64
hidden_size = 8
max_fragments = 20
[induction]
max_k = 3
n_starts = 1
n_folds = 2
[classifier]
epochs = 4
hidden_size = 8
n_folds = 2
[planes]
epochs = 4
hidden_size = 8
n_folds = 2
[baselines]
epochs = 4
plane_epochs = 4
hidden_size = 8
embedding_size = 4
n_folds = 2
[search]
max_rounds = 2
n_searches = 1
"""
STUDY = """
[study]
seed = 3
[collect]
trials = 6
setups = ["N1M1"]
foods = ["carrot"]
[split]
rule = "share"
share = 0.5
[train]
[evaluate]
methods = ["random"]
world = "bench"
runs = 1
trials = 1
[[variants]]
name = "one"
question = "why"
settings.search.max_rounds = 3
"""


def make_good(folder: Path, urdf: Path) -> None:
    """Fill `folder` with a data set, a model, a run, settings, a study, meshes and a URDF."""
    (folder / "settings.toml").write_text(SETTINGS)
    (folder / "study.toml").write_text(STUDY)
    shutil.copy(urdf, folder / "arm.urdf")
    box = trimesh.creation.box((0.06, 0.04, 0.03))
    for suffix in ("stl", "obj", "ply", "glb"):
        box.export(folder / f"box.{suffix}")
    here = {"data": folder / "data", "model": folder / "model", "run": folder / "run"}
    commands = (
        f"collect --out {here['data']} --trials 6 --setups N1M1 --foods carrot block --seed 3 --workers 0",
        f"split {here['data']} --out {here['data']} --rule share --share 0.5",
        f"train --data {here['data']} --split share --out {here['model']} --settings {folder / 'settings.toml'}",
        f"evaluate --data {here['data']} --model {here['model']} --out {here['run']} --methods random largest "
        "--world bench --runs 1 --trials 2 --workers 0 --record all",
    )
    with (folder / "log.txt").open("w") as log, redirect_stdout(log):
        for command in commands:
            if code := main([*command.split(), "--quiet"]):
                raise RuntimeError(f"exit code {code}: cutgrammar {command}")
    for method, file in RECORDINGS.items():
        next((here["run"] / "recordings").glob(f"N1M1-1-in-place-{method}-*.rrd")).rename(folder / file)
    shutil.rmtree(here["run"] / "recordings")
    (folder / "log.txt").unlink()
    _make_recorded(folder / RECORDED)
    key = read_planned(ledger_of(here["run"]))[0]
    store = RatingStore(folder / RATINGS)
    for answer in (1, 2):
        store.add(
            Rating("P1", False, "a" * 64, RESULT, key.digest, None, 0, answer, 3, 2.5, "2026-11-27T18:00:00+00:00")
        )
    store.close()
    journal = Journal(folder / JOURNAL)
    stroke = {"p_WE": [0.0, -1.0, 0.5], "first_W": [0.0, 0.9, -0.4], "second_W": [0.0, 0.8, -0.6], "explode": 0.0}
    stroke |= {"first_seconds": 1.0, "second_seconds": 2.0, "cut_seconds": 3.0}
    for entry in (
        {"do": "start", "participant": "P1", "robot": False, "start": "a" * 64},
        {"do": "cut", "fragment": 0, "plane_W": [1.0, 0.0, 0.0, 0.0], "stroke": stroke, "robot": False, "seconds": 3.0},
        {"do": "undo", "robot": False, "seconds": 4.0},
        {"do": "resume", "robot": False},
        {"do": "save", "robot": False, "seconds": 5.0},
    ):
        journal.append(entry)
    (folder / "trajectory.json").write_bytes(trajectory_to_json(_trajectory()))


def _make_recorded(folder: Path) -> None:
    """Two demonstrations of a box that is cut into four slices, without meshes of the slices and with them."""
    folder.mkdir()
    whole, half = trimesh.creation.box((0.06, 0.04, 0.03)), trimesh.creation.box((0.03, 0.04, 0.03))
    whole.export(folder / "whole.stl")
    for suffix in ("obj", "ply", "glb"):
        half.export(folder / f"half.{suffix}")

    def pose(x: float) -> dict[str, list[float]]:
        return {"position": [x, 0.0, 0.015], "quaternion": [1.0, 0.0, 0.0, 0.0]}

    def cut(fragment: str, x: float, *products: dict[str, Any], **others: Any) -> dict[str, Any]:
        return {"fragment": fragment, "plane": {"normal": [1.0, 0.0, 0.0], "offset": -x}, "products": products} | others

    box = {"name": "box", "food": "block", "mesh": "whole.stl", "pose": pose(0.0)}
    facts = {
        "format": "cutgrammar demonstration",
        "version": 1,
        "unit": "m",
        "categories": ["slices"],
        "objects": [box],
    }
    right = {"name": "right", "mesh": "half.obj", "pose": pose(0.02)}
    left = {"name": "left", "mesh": "half.ply", "pose": pose(-0.02)}
    last = ({"name": "a", "category": "slices"}, {"name": "b"})
    for name, cuts in (
        ("one", [cut("box", 0.0, {"name": "right"}, {"name": "left"}), cut("right", 0.02, *last)]),
        ("two", [cut("box", 0.0, right, left), cut("right", 0.02, *last, poses={"left": pose(-0.05)})]),
    ):
        (folder / f"{name}.json").write_text(json.dumps(facts | {"demonstrator": "P1", "cuts": cuts}))


def _trajectory() -> Trajectory:
    """Two joints that move and come to rest."""
    limits = Limits(np.array([[-3.0, 3.0], [-np.inf, np.inf]]), np.ones(2), np.ones(2))
    values = np.linspace(0.0, 0.2, 8).reshape(4, 2)
    plane = Plane(np.array([1.0, 0.0, 0.0]), 0.0)
    phases = (("approach", 0.0), ("cut", 0.2))
    cut = CutTrajectory(
        1, plane, np.zeros((1, 3)), None, 0.0, 0.0, phases, np.arange(4) / 10, values, 0 * values, values
    )
    return Trajectory("N1M1-1-in-place-random", "arm", ("first", "second"), limits, (cut,))


def trust_good_parts(folder: Path, good: Path) -> None:
    """Take copies of good parts for what they are, so that only changed ones are read by a process of their own."""
    for file in (good / "data").glob("*/*.parquet"):
        copy = folder / file.relative_to(good)
        if copy.is_file() and copy.stat().st_size == file.stat().st_size and copy.read_bytes() == file.read_bytes():
            trust_footer(copy)


def change_json(file: Path, change: Callable[[Any], Any]) -> None:
    """Replace the content of a JSON file by what `change` returns, or by what it changed if that is None."""
    content = json.loads(file.read_bytes())
    changed = change(content)
    file.write_text(json.dumps(content if changed is None else changed))


def sign_data(data: Path) -> None:
    """Give a data set's manifest the digests of its parts, and its splits that of the manifest."""
    file = data / "manifest.json"
    manifest = json.loads(file.read_bytes())
    for part in manifest["parts"]:
        name = f"part-{part['number']:05d}.parquet"
        part["sha256"] = {t: _digest(data / t / name) for t in ALL_SCHEMAS if (data / t / name).is_file()}
    file.write_bytes(json_bytes(manifest))
    for split in (data / "splits").glob("*.json"):
        change_json(split, lambda facts: facts.update(data=_digest(file)))


def sign_model(model: Path) -> None:
    """Give a model's `model.json` the digests of its files."""
    change_json(
        model / "model.json", lambda facts: facts.update(files={name: _digest(model / name) for name in facts["files"]})
    )


def unsafe_npz(**arrays: Any) -> bytes:
    """An archive of arrays as NumPy writes it, objects included."""
    import io

    out = io.BytesIO()
    np.savez_compressed(out, **arrays)
    return out.getvalue()


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
