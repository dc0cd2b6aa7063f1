"""3. Plan one cut at a time and carry it out: a planner against a world.

Run: python docs/examples/03_plan_and_cut.py [FOLDER]       (the folder of example 2)
"""

import sys
from functools import partial
from pathlib import Path

from cutgrammar.events import CutMade, Planned, Scored
from cutgrammar.learning.model import load_model
from cutgrammar.methods.grammar import make_planner
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings
from cutgrammar.storage.data_set import DataSet
from cutgrammar.trials.goals import goal_for
from cutgrammar.trials.run_trial import run_trial
from cutgrammar_sim.worlds.bench import make_world

folder, settings = Path(sys.argv[1] if len(sys.argv) > 1 else "example"), Settings()
demonstration = DataSet.open(folder / "data").demonstration(0)
model = load_model(folder / "model")
streams = partial(stream, 0, "example")
goal = goal_for(demonstration, "in-place", streams("goal"))


def tell(event: object) -> None:
    """An observer: print what happens."""
    match event:
        case Planned(step=step, cut=cut) if cut.explanation is not None:
            print(f"{step}: {cut.explanation.production}, log posterior {cut.explanation.log_posterior:.1f}")
        case CutMade(configuration=configuration):
            print(f"   now {len(configuration)} of {len(goal)} fragments")
        case Scored(iou_strict=strict):
            print(f"strict IoU {strict:.2f}")


run_trial(
    demonstration.start,
    goal,
    make_planner(model, settings),
    make_world(settings, streams),
    [tell],
    streams,
    settings.trial,
)
