import hashlib
import json
import pickle
import shutil
import subprocess
import sys
import weakref
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.grammar.production import Grammar
from cutgrammar.learning.learn import learn
from cutgrammar.learning.model import Model, Provenance, load_model, save_model
from cutgrammar.learning.settings_used import settings_used
from cutgrammar.learning.training_fragments import training_fragments
from cutgrammar.nn.mlp import MLP
from cutgrammar.perception.vision.neighbourhoods import EDGE_FEATURES, POINT_FEATURES
from cutgrammar.perception.vision.segmentation import Segmentation
from cutgrammar.settings import PlaneSettings, SearchSettings, VisionSettings
from cutgrammar.trials.setups import SETUPS
from cutgrammar_sim.demonstrator.demonstrate import make_demonstration
from cutgrammar_sim.foods import block, carrot
from short_training import SHORT


def provenance(seed=0):
    return Provenance("d" * 64, "paper", "s" * 64, (0, 1, 2), seed, "0.0.0")


@pytest.fixture(scope="module")
def demonstrations():
    foods = {"carrot": carrot, "block": block}
    return [
        make_demonstration(i, SETUPS["N1M1"], (category,), foods, 5, SHORT.demonstrator)
        for i, category in enumerate(("slices", "chunks", "strips"))
    ]


@pytest.fixture(scope="module")
def learned(demonstrations):
    return learn(demonstrations, SHORT, provenance())


@pytest.fixture
def saved(learned, tmp_path):
    save_model(learned.model, tmp_path / "model")
    return tmp_path / "model"


def test_a_model_comes_back_as_it_was(learned, saved):
    model, again = learned.model, load_model(saved)
    assert again.digest == model.digest
    assert again.files == model.files
    assert (again.settings, again.provenance, again.grammar) == (model.settings, model.provenance, model.grammar)


def test_a_model_keeps_its_digest_where_a_later_release_added_settings(saved, tmp_path):
    facts = json.loads((saved / "model.json").read_text())
    del facts["settings"]["vision"]["seams"]
    (saved / "model.json").write_text(json.dumps(facts))
    model = load_model(saved)
    assert model.digest == hashlib.sha256((saved / "model.json").read_bytes()).hexdigest()
    assert model.settings.vision == VisionSettings()
    assert pickle.loads(pickle.dumps(model)).digest == model.digest
    save_model(model, tmp_path / "copy")
    assert load_model(tmp_path / "copy").digest == model.digest
    assert replace(model, metrics={"cuts": 1.0}).digest != model.digest


def test_a_model_that_came_back_answers_with_the_same_bits(learned, saved, demonstrations):
    shape = demonstrations[0].fragments[0].mesh
    answers = []
    for model in (learned.model, load_model(saved)):
        z = model.features(shape)
        production = min(model.grammar.probabilities)
        plane = model.planes.sample(production, z, np.random.default_rng(0))
        answers.append((z.tobytes(), model.classifier.log_probabilities(z).tobytes(), plane.to_vector().tobytes()))
    assert answers[0] == answers[1]


def test_the_same_demonstrations_give_the_same_model_and_progress_is_reported(learned, demonstrations):
    progress = []
    again = learn(demonstrations, SHORT, provenance(), lambda *step: progress.append(step))
    assert again.model.files == learned.model.files
    last = {stage: (done, total) for stage, done, total, *_ in progress}
    assert list(last) == ["encoder", "features", "induction", "classifier", "planes", "bc", "qnet", "goal_planes"]
    assert all(done == total for done, total in last.values())


def test_settings_that_learning_does_not_read_make_no_other_model():
    assert settings_used(replace(SHORT, search=SearchSettings(max_rounds=3))) == settings_used(SHORT)
    assert settings_used(replace(SHORT, planes=PlaneSettings())) != settings_used(SHORT)


def test_every_fragment_has_one_type_and_every_cut_a_production(learned, demonstrations):
    fragments = training_fragments(demonstrations)
    assert len(learned.induction.types) == len(fragments.meshes) == sum(len(d.fragments) for d in demonstrations)
    assert len(fragments.cuts) == sum(len(d.cuts) for d in demonstrations)
    assert learned.model.metrics["fragments"] == len(fragments.meshes)


def test_undone_cuts_and_their_products_are_ignored(demonstrations):
    one = demonstrations[0]
    last = one.cuts[-1]
    undone = replace(one, cuts=(*one.cuts[:-1], replace(last, undone=True)))
    fragments = training_fragments([undone])
    assert len(fragments.meshes) == len(one.fragments) - len(last.products)
    assert len(fragments.cuts) == len(one.cuts) - 1
    volumes = [mesh.volume for mesh in fragments.meshes]
    assert all(volumes[cut] == pytest.approx(sum(volumes[i] for i in made)) for cut, made, _ in fragments.cuts)


def test_trials_without_cuts_are_an_error(demonstrations):
    with pytest.raises(ValueError, match="no cut"):
        learn([replace(demonstrations[0], cuts=())], SHORT, provenance())


def test_a_person_can_read_the_grammar(saved):
    grammar = json.loads((saved / "grammar.json").read_text())
    texts = [row["text"] for row in grammar["productions"]]
    assert all(text.startswith("c") and " -> c" in text for text in texts)
    assert [point["k"] for point in grammar["induction"]["curve"]][:2] == [1, 2]


def test_nothing_on_disk_is_a_pickle(saved):
    for file in saved.iterdir():
        with pytest.raises(pickle.UnpicklingError):
            pickle.loads(file.read_bytes())


def test_a_model_travels_between_processes(learned):
    assert pickle.loads(pickle.dumps(learned.model)).digest == learned.model.digest


def test_planning_with_a_model_does_not_import_torch():
    code = "import sys, cutgrammar.learning.model, cutgrammar.methods.grammar; print('torch' in sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert said.strip() == "False"


def test_parts_that_do_not_fit_make_no_model(learned):
    with pytest.raises(ValueError, match="types"):
        replace(learned.model, grammar=Grammar(1, {}, (1.0,)))


def test_an_existing_folder_is_not_overwritten(learned, saved):
    with pytest.raises(InputError, match="exists already"):
        save_model(learned.model, saved)


def broken(saved, tmp_path, change):
    copy = tmp_path / "broken"
    shutil.copytree(saved, copy)
    change(copy)
    with pytest.raises(InputError) as error:
        load_model(copy)
    assert "\n" not in str(error.value)
    return str(error.value)


def with_facts(change):
    def make(folder):
        facts = json.loads((folder / "model.json").read_text())
        change(facts)
        (folder / "model.json").write_text(json.dumps(facts))

    return make


@pytest.mark.parametrize(
    "name",
    [
        "encoder.safetensors",
        "classifier.safetensors",
        "planes.safetensors",
        "bc.safetensors",
        "qnet.safetensors",
        "goal_planes.safetensors",
        "grammar.json",
    ],
)
def test_a_part_that_is_missing_or_damaged_is_named(saved, tmp_path, name):
    assert f"lacks {name}" in broken(saved, tmp_path / "a", lambda folder: (folder / name).unlink())
    half = (saved / name).read_bytes()[:-20]
    assert f"{name} is damaged" in broken(saved, tmp_path / "b", lambda folder: (folder / name).write_bytes(half))


def test_a_folder_that_is_no_model_is_refused(saved, tmp_path):
    with pytest.raises(InputError, match="does not exist; train one"):
        load_model(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="has no model.json"):
        load_model(tmp_path / "empty")
    assert "damaged" in broken(saved, tmp_path / "a", lambda folder: (folder / "model.json").write_text('{"schema": '))
    assert "not a model's" in broken(saved, tmp_path / "b", lambda folder: (folder / "model.json").write_text("[]"))
    assert "schema 99" in broken(saved, tmp_path / "c", with_facts(lambda facts: facts.update(schema=99)))
    assert "unknown setting" in broken(
        saved, tmp_path / "d", with_facts(lambda facts: facts["settings"].update(kitchen={}))
    )
    assert "other files" in broken(saved, tmp_path / "e", with_facts(lambda facts: facts["files"].clear()))
    assert "not a model's" in broken(saved, tmp_path / "f", with_facts(lambda facts: facts["provenance"].pop("seed")))


def test_exchanged_networks_are_refused(saved, tmp_path):
    def swap(folder):
        content = (folder / "encoder.safetensors").read_bytes()
        (folder / "planes.safetensors").write_bytes(content)
        digest = hashlib.sha256(content).hexdigest()
        with_facts(lambda facts: facts["files"].update({"planes.safetensors": digest}))(folder)

    assert "not a network for cutting planes" in broken(saved, tmp_path, swap)
    assert isinstance(load_model(saved), Model)


def test_a_model_with_a_segmentation_comes_back_with_it_and_one_of_another_kind_is_refused(learned, tmp_path):
    describing = MLP((np.zeros((POINT_FEATURES, 2)),), (np.zeros(2),))
    segmentation = Segmentation(describing, (), MLP((np.ones((4 + EDGE_FEATURES, 1)),), (np.ones(1),)), 0.4)
    model = replace(learned.model, segmentation=segmentation)
    save_model(model, tmp_path / "seeing")
    again = load_model(tmp_path / "seeing")
    assert again.segmentation.to_bytes() == segmentation.to_bytes()
    assert again.digest == model.digest != learned.model.digest
    assert pickle.loads(pickle.dumps(model)).digest == model.digest

    def swap(folder):
        content = (folder / "encoder.safetensors").read_bytes()
        (folder / "segmentation.safetensors").write_bytes(content)
        digest = hashlib.sha256(content).hexdigest()
        with_facts(lambda facts: facts["files"].update({"segmentation.safetensors": digest}))(folder)

    assert "not a segmentation" in broken(tmp_path / "seeing", tmp_path, swap)


def test_learning_reads_demonstrations_one_by_one_and_keeps_no_mesh(learned, demonstrations):
    alive = weakref.WeakSet()

    class Read(Sequence):
        def __len__(self):
            return len(demonstrations)

        def __getitem__(self, index):
            one = demonstrations[index]
            fragments = (replace(f, mesh=Mesh(f.mesh.vertices, f.mesh.faces)) for f in one.fragments)
            copy = replace(one, fragments=tuple(fragments))
            assert len(alive) < 2, "the demonstrations before the last one are still in memory"
            alive.add(copy)
            return copy

    assert learn(Read(), SHORT, provenance()).model.files == learned.model.files
