"""3. Plan one cut at a time and carry it out: a planner against a world.

Run: python docs/examples/03_plan_and_cut.py [FOLDER]       (the folder of example 2)
"""

import sys
from functools import partial
from pathlib import Path

from cutgrammar import (
    CutMade,
    DataSet,
    Planned,
    PlanningContext,
    Scored,
    Settings,
    find_method,
    goal_for,
    load_model,
    run_trial,
    stream,
)
from cutgrammar_sim import Bench

folder, settings = Path(sys.argv[1] if len(sys.argv) > 1 else "example"), Settings()
demonstration = DataSet.open(folder / "data").demonstration(0)
model = load_model(folder / "model")
streams = partial(stream, 0, "example")
goal = goal_for(demonstration, "in-place", streams("goal"))


def show(event: object) -> None:
    """An observer: print what happens."""
    match event:
        case Planned(step=step, cut=cut) if cut.explanation is not None:
            print(f"{step}: {cut.explanation.production}, log posterior {cut.explanation.log_posterior:.1f}")
        case CutMade(configuration=configuration):
            print(f"   now {len(configuration)} of {len(goal)} fragments")
        case Scored(scores={"iou_strict": strict}):
            print(f"strict IoU {strict:.2f}")


run_trial(
    demonstration.start,
    goal,
    find_method("grammar").planner(PlanningContext(model, settings)),
    Bench(settings.world.min_share),
    [show],
    streams,
    settings.trial,
)
