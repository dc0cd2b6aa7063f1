"""A small data set with a model, which evaluations share."""

import pytest

from cutgrammar.learning.model import save_model
from cutgrammar.storage.split import make_split, write_split
from cutgrammar_pipelines.config import CollectConfig
from cutgrammar_pipelines.stages.collect import collect
from untrained_model import untrained


@pytest.fixture(scope="session")
def given(tmp_path_factory):
    """A folder with a small data set, its split and a model."""
    folder = tmp_path_factory.mktemp("given")
    data = collect(CollectConfig(out=folder / "data", trials=6, setups=["N1M1", "N1M2"], workers=0))
    split = make_split(data)
    write_split(data, split)
    save_model(untrained(data, split), folder / "model")
    return folder


@pytest.fixture
def run(tmp_path):
    """Where an evaluation writes."""
    return tmp_path / "run"
