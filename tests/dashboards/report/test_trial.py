"""What a reader can turn: the bytes in the page are the meshes, and pairs lie as the metric compares them."""

import base64
import dataclasses
import json
import zlib

import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.comparison.overlap import Solid
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.results.report import TrialPicture, TrialResult
from cutgrammar_dashboards.pages.one_file import one_script
from cutgrammar_dashboards.pages.packed_meshes import MAX_FACES, STEPS, pack
from cutgrammar_dashboards.report.panels import RADIUS, Panels
from cutgrammar_dashboards.report.trial import TrialDrawer


@pytest.fixture(scope="module")
def trial(story):
    start, goal, events = story
    result = TrialResult("reached", "", events[-2].configuration, events[-1].pairs)
    return TrialPicture("a: worst", start, goal, (result,))


def unpacked(packed):
    """The meshes of `pack`, read by its description alone."""
    content, meshes = zlib.decompress(base64.b64decode(packed["data"])), []
    for n, m, step, *low in packed["sizes"]:
        count = 3 * (n + m)
        low_bytes, high_bytes = np.frombuffer(content[: 2 * count], np.uint8).reshape(2, count).astype(int)
        numbers = low_bytes + 256 * high_bytes
        content = content[2 * count :]
        codes = numbers[: 3 * n]
        steps = np.where(codes % 2, -(codes + 1) // 2, codes // 2).reshape(3, n).cumsum(axis=1)
        corners, unused = [], 0
        for below in numbers[3 * n :].tolist():
            corners.append(unused - below)
            unused += below == 0
        meshes.append((low + step * steps.T, np.array(corners).reshape(m, 3)))
    assert content == b""
    return meshes


def test_a_packed_mesh_is_the_mesh(lump):
    ((vertices, faces),) = unpacked(pack([lump]))
    error = np.abs(vertices[faces] - lump.triangles).max()
    assert error < 0.51 * np.ptp(lump.vertices, axis=0).max() / (STEPS - 1)


def test_a_dense_mesh_is_simplified_and_keeps_its_shape():
    ball = trimesh.creation.icosphere(6, 0.05)
    ((vertices, faces),) = unpacked(pack([Mesh(ball.vertices, ball.faces)]))
    assert 1000 < len(faces) <= MAX_FACES
    assert np.abs(np.linalg.norm(vertices, axis=1) - 0.05).max() < 0.002


def test_matched_fragments_share_a_colour_and_others_are_grey(trial):
    result = dataclasses.replace(trial.results[0], pairs=trial.results[0].pairs[:-1])
    goal, reached, pairs = json.loads(Panels(dataclasses.replace(trial, results=(result,))).to_json())["panels"]
    by_pair = {one["pair"]: one["colour"] for one in reached["fragments"]}
    assert by_pair == {one["pair"]: one["colour"] for one in goal["fragments"]}
    assert by_pair[-1] == "#969696"
    assert len(set(by_pair.values())) == 4
    assert [one["pair"] for one in pairs["fragments"]].count(-1) == 0
    assert [one["colour"] is None for one in pairs["fragments"]] == [False, True] * 3


def test_a_pair_lies_as_the_metric_compares_it(trial):
    data = json.loads(Panels(trial).to_json())
    meshes, panel = unpacked(data["meshes"]), data["panels"][-1]
    solids = []
    for one in panel["fragments"]:
        vertices, faces = meshes[one["mesh"]]
        rotation = np.array(one["rotation"]).reshape(3, 3)
        solids.append(Mesh(panel["scale"] * vertices @ rotation.T + one["position"], faces))
    for number, (i, j, iou) in enumerate(sorted(trial.results[0].pairs, key=lambda pair: -pair[2])):
        over, under = solids[2 * number : 2 * number + 2]
        assert shared(over, under) == pytest.approx(iou, abs=0.01), (i, j)
    assert max(np.linalg.norm(solid.vertices, axis=1).max() for solid in solids) == pytest.approx(RADIUS, rel=0.01)


def shared(a, b):
    one, other = (Solid.__new__(Solid) for _ in range(2))
    for solid, mesh in ((one, a), (other, b)):
        solid.mesh, solid.volume = mesh, mesh.volume
    return one.iou_with(other, Pose.identity().rotation)


def test_two_results_share_the_goals_meshes_and_have_panels_of_their_own(trial):
    (result,) = trial.results
    both = (dataclasses.replace(result, title="run A"), dataclasses.replace(result, title="run B"))
    data = json.loads(Panels(dataclasses.replace(trial, results=both)).to_json())
    titles = [panel["title"] for panel in data["panels"]]
    assert titles == ["goal", "run A", "run B", "matched pairs, run A", "matched pairs, run B"]
    assert len(data["meshes"]["sizes"]) == 12


def test_trials_beyond_the_size_of_a_page_have_only_their_pictures(trial):
    drawer = TrialDrawer(max_bytes=len(Panels(trial).to_json()))
    first, second = drawer.draw(trial), drawer.draw(trial)
    assert first.fragments
    assert not first.why_not
    assert not second.fragments
    assert "too large" in second.why_not
    assert second.picture == first.picture


def test_modules_become_one_script_that_cannot_end_its_element():
    contents = {
        "a.js": b'const x="</SCRIPT><!--";export{x as A,y as B};\n//# sourceMappingURL=a.js.map',
        "b.js": b'import { A, B } from "./a.js";\nexport class C {}\nexport const D = A;\n',
    }
    script = one_script(contents, ["a.js", "b.js"])
    assert "const { A, B } = modules['a.js'];" in script
    assert "return { A: x, B: y };" in script
    assert "return { C: C, D: D };" in script
    assert not any(word in script for word in ("</SCRIPT", "<!--", "sourceMappingURL", "export ", "import "))
    with pytest.raises(ValueError, match=r"b.js imports a.js, which must be one of"):
        one_script(contents, ["b.js", "a.js"])
    with pytest.raises(ValueError, match="cannot be put into one script"):
        one_script({"c.js": b"export default 3;"}, ["c.js"])
