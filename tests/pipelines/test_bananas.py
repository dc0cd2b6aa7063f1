"""A banana is bent: one straight cut can make three fragments of it. Its data, its model and its plans."""

from functools import partial
from itertools import product

import numpy as np
import pytest

from cutgrammar.events import CutMade, Planned, Scored
from cutgrammar.grammar.text import describe
from cutgrammar.learning.model import load_model
from cutgrammar.methods.grammar import GrammarPlanner
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings, TrialSettings, from_tables
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar.trials.run_trial import run_trial
from cutgrammar_pipelines.config import CollectConfig, EvaluateConfig, SplitConfig, TrainConfig
from cutgrammar_pipelines.stages.collect import collect
from cutgrammar_pipelines.stages.evaluate import evaluate
from cutgrammar_pipelines.stages.splitting import split
from cutgrammar_pipelines.stages.train import train
from cutgrammar_sim.worlds.bench import Bench

QUICK = from_tables(
    {
        "features": {"epochs": 20, "n_points": 256, "hidden_size": 32},
        "induction": {"max_k": 8, "n_starts": 1, "n_folds": 2},
        "classifier": {"epochs": 300, "hidden_size": 32, "n_folds": 2},
        "planes": {"epochs": 60, "hidden_size": 16, "n_folds": 2},
        "baselines": {"epochs": 4, "plane_epochs": 4, "hidden_size": 8, "n_folds": 2},
    },
    __file__,
)


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def learned(tmp_path_factory):
    """Data of bananas, most of them trained on, and the model of them."""
    folder = tmp_path_factory.mktemp("bananas")
    collect(CollectConfig(out=folder / "data", trials=12, seed=3, setups=["N1M1"], foods=["banana"], workers=0))
    split(SplitConfig([folder / "data"], out=folder / "data", rule="share", share=0.7))
    train(TrainConfig(data=folder / "data", out=folder / "model", settings=QUICK, split="share"))
    return folder


def three_way(learned):
    """The demonstrations of a data set with a first cut that makes three fragments."""
    data = DataSet.open(learned / "data")
    made = [data.demonstration(summary.trial) for summary in data.trials]
    return [demonstration for demonstration in made if len(demonstration.cuts[0].products) == 3]


def test_a_demonstrated_cut_of_a_banana_makes_three_fragments_that_keep_its_volume(learned):
    found = three_way(learned)
    assert len(found) >= 3
    for demonstration in found:
        whole, products = demonstration.fragments[0].mesh, demonstration.cuts[0].products
        assert sum(demonstration.fragments[i].mesh.volume for i in products) == pytest.approx(whole.volume, rel=1e-9)


def test_productions_with_three_children_are_induced_and_printed(learned):
    grammar = load_model(learned / "model").grammar
    wide = [production for production in grammar.probabilities if len(production.children) == 3]
    assert wide
    printed = describe(grammar)
    for production in wide:
        assert " ".join(f"c{child}" for child in production.children) in printed


def test_a_banana_in_three_is_planned_as_one_production_and_cut_by_one_plane(learned):
    model, wide = load_model(learned / "model"), []
    for demonstration, run in product(three_way(learned), range(4)):
        goal = tuple(demonstration.fragment_at(1, i) for i in demonstration.cuts[0].products)
        planner, streams = GrammarPlanner(model, Settings()), partial(stream, run, "bananas")
        events = run_trial(demonstration.start, goal, planner, Bench(1e-3), (), streams, TrialSettings())
        assert isinstance(events[-1], Scored)
        if isinstance(events[0], Planned) and isinstance(events[1], CutMade):
            wide.append((events[0].cut.explanation.production.count("c"), events[1].products))
    assert (1 + 3, 3) in wide  # a parent and three children; three products


def test_trials_with_bananas_are_evaluated_on_the_bench(learned):
    ended = evaluate(
        EvaluateConfig(
            data=learned / "data",
            model=learned / "model",
            out=learned / "run",
            methods=["grammar", "replay"],
            runs=1,
            world="bench",
            workers=0,
            settings=QUICK,
        )
    )
    assert ended.complete
    assert not ended.failed + ended.crashed
    records = read_records(ledger_of(learned / "run"))
    again = [record.iou_strict for record in records if record.key.method == "replay"]
    assert np.min(again) == pytest.approx(1.0, abs=1e-6)
