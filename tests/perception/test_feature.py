import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

from cutgrammar.geometry.canonical import FLIPS
from cutgrammar.geometry.fragment import Cloud, Mesh
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.learning.encoder_training import fit_features
from cutgrammar.nn.mlp import to_bytes
from cutgrammar.perception.encoder import flipped
from cutgrammar.perception.feature import FeatureExtractor, normalised, scale_of, z_scale
from cutgrammar.perception.occupancy import inside


def test_the_feature_does_not_depend_on_the_pose(extractor, lump, random_pose):
    assert np.abs(extractor(lump.moved(random_pose())) - extractor(lump)).max() < 1e-9


def test_the_feature_hardly_depends_on_the_triangulation(extractor, lump, random_pose, remeshed):
    z, again = extractor(lump), extractor(remeshed(lump, random_pose()))
    assert again[-1] == pytest.approx(z[-1], abs=1e-9)
    assert np.linalg.norm(again - z) < 0.25  # of a total variance of 1 over the training set


def test_only_the_scale_changes_with_the_size(extractor, lump):
    z, double = extractor(lump), extractor(Mesh(2 * lump.vertices, lump.faces))
    assert double[:-1] == pytest.approx(z[:-1], abs=1e-9)
    assert double[-1] - z[-1] == pytest.approx(2 * np.log(2))


def test_the_scale_can_be_recovered(extractor, lump):
    assert scale_of(extractor(lump)) == pytest.approx(normalised(lump, 16).scale)
    assert z_scale(0.01) == 0.0


def test_the_largest_coordinate_of_a_normalised_shape_is_one(lump):
    seen = normalised(lump, 300)
    assert np.abs(seen.mesh.vertices).max() == 1.0
    assert np.abs(seen.cloud.points).max() <= 1.0
    assert np.abs(seen.mesh.centroid).max() < 1e-9


def test_a_cloud_has_nearly_the_feature_of_its_mesh(extractor, lump):
    seen = sample_surface(lump, 5000)
    z, of_cloud = extractor.flipped(lump), extractor(Cloud(seen.points, seen.normals))
    assert np.linalg.norm(z - of_cloud, axis=1).min() < 0.3  # its axes are those of the surface, not of the volume


def test_the_first_flip_is_the_feature_itself(extractor, lump):
    rows = extractor.flipped(lump)
    assert rows.shape == (4, 17)
    assert (rows[0] == extractor(lump)).all()


def test_each_flip_is_the_feature_of_the_rotated_cloud(extractor, lump):
    seen = normalised(lump, extractor.points)
    for row, flip, turned in zip(extractor.flipped(lump), FLIPS, flipped(seen.cloud), strict=True):
        assert (turned.points == flip.apply(seen.cloud.points)).all()
        assert (row[:-1] == extractor.encoder(turned)).all()


def test_the_decoder_finds_the_inside_of_shapes_like_the_training_shapes(training, blocks, rng):
    extractor, trained = training
    shares = []
    for mesh in blocks(6, seed=8):
        seen = normalised(mesh, extractor.points)
        points = rng.uniform(-1, 1, size=(1500, 3)) * np.abs(seen.mesh.vertices).max(axis=0) * 1.2
        truth = inside(seen.mesh, points)
        found = trained.decoder(extractor.encoder(seen.cloud), points) > 0.5
        shares.append((truth & found).sum() / (truth | found).sum())
    assert np.mean(shares) > 0.6


def test_training_reduces_the_loss(training, quick):
    losses = training[1].losses
    assert len(losses) == quick.epochs
    assert losses[-1] < 0.75 * losses[0]


def test_features_of_the_training_fragments_have_mean_zero_and_total_variance_one(training, blocks):
    rows = np.concatenate([training[0].flipped(mesh)[:, :-1] for mesh in blocks(12)])
    assert np.abs(rows.mean(axis=0)).max() < 1e-6
    assert rows.var(axis=0).sum() == pytest.approx(1.0)


def test_training_is_deterministic_and_ignores_global_generators(quick, blocks):
    settings = replace(quick, epochs=2)
    meshes = blocks(5)

    def trained(seed):
        torch.manual_seed(int(np.random.default_rng().integers(1000)))
        return fit_features(meshes, settings, np.random.default_rng(seed))[0].to_bytes()

    assert trained(0) == trained(0)
    assert trained(0) != trained(1)


def test_a_last_batch_or_training_set_of_one_fragment_is_allowed(quick, blocks, lump):
    settings = replace(quick, epochs=1, batch_size=4)
    for count in (1, 5):
        extractor, _ = fit_features(blocks(count), settings, np.random.default_rng(0))
        assert np.isfinite(extractor(lump)).all()


def test_of_many_fragments_only_some_train_the_encoder(quick, blocks):
    taken = []

    class Recorded(list):
        def __getitem__(self, i):
            taken.append(int(i))
            return super().__getitem__(i)

    fit_features(Recorded(blocks(8)), replace(quick, epochs=1, max_fragments=3), np.random.default_rng(0))
    assert len(taken) == len(set(taken)) == 3


def test_an_empty_training_set_is_refused(quick):
    with pytest.raises(ValueError, match="at least one training fragment"):
        fit_features([], quick, np.random.default_rng(0))


def test_an_extractor_survives_serialisation(extractor, lump):
    again = FeatureExtractor.from_bytes(extractor.to_bytes())
    assert again.to_bytes() == extractor.to_bytes()
    assert (again(lump) == extractor(lump)).all()


def test_invalid_bytes_are_refused(extractor):
    for data in (b"", b"nothing", extractor.to_bytes()[:-8]):
        with pytest.raises(ValueError, match="safetensors"):
            FeatureExtractor.from_bytes(data)
    with pytest.raises(ValueError, match="not an encoder"):
        FeatureExtractor.from_bytes(to_bytes(extractor.encoder.points))


@pytest.mark.slow
def test_the_feature_is_identical_for_any_number_of_threads(extractor, lump, tmp_path):
    (tmp_path / "encoder").write_bytes(extractor.to_bytes())
    np.save(tmp_path / "vertices.npy", lump.vertices)
    np.save(tmp_path / "faces.npy", lump.faces)
    code = (
        "import sys; import numpy as np; from pathlib import Path;"
        "from cutgrammar.perception.feature import FeatureExtractor; from cutgrammar.geometry.fragment import Mesh;"
        "at = Path(sys.argv[1]); mesh = Mesh(np.load(at / 'vertices.npy'), np.load(at / 'faces.npy'));"
        "print(FeatureExtractor.from_bytes((at / 'encoder').read_bytes())(mesh).tobytes().hex())"
    )
    outputs = set()
    for threads in ("1", "2"):
        environment = {**os.environ, "OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads}
        command = [sys.executable, "-c", code, str(tmp_path)]
        outputs.add(subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout)
    assert outputs == {extractor(lump).tobytes().hex() + "\n"}
