"""2. Demonstrations, a data set, a grammar: the learning half of the paper through Python.

Run: python docs/examples/02_from_demonstrations_to_a_grammar.py [FOLDER]       (or example, in the current folder)
"""

import sys
from dataclasses import replace
from pathlib import Path

from cutgrammar import DataSet, FeatureSettings, InductionSettings, Settings, load_model
from cutgrammar_pipelines import CollectConfig, SplitConfig, TrainConfig, collect, split, train

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "example")
settings = replace(  # small, to be quick: the defaults take longer and learn more
    Settings(), features=FeatureSettings(epochs=5), induction=InductionSettings(max_k=12, n_starts=2)
)

collect(CollectConfig(out=folder / "data", trials=20, seed=0, workers=0, settings=settings))
split(SplitConfig((folder / "data",), out=folder / "data"))
data = DataSet.open(folder / "data")
print(f"{len(data.trials)} trials, digest {data.digest[:12]}")

demonstration = data.demonstration(data.trials[0].trial)
print(f"trial 0: {demonstration.setup}, {demonstration.foods}, {len(demonstration.goal)} fragments in the goal")

train(TrainConfig(data=folder / "data", out=folder / "model", settings=settings))
grammar = load_model(folder / "model").grammar
for production, probability in sorted(grammar.probabilities.items()):
    print(f"  {probability:.2f}  {production}")
