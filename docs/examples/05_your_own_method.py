"""5. Your own method: this file and a `pyproject.toml` are a whole package that adds one.

Save it as `halver.py` beside this `pyproject.toml`, and `pip install .` there:

    [build-system]
    requires = ["hatchling"]
    build-backend = "hatchling.build"

    [project]
    name = "halver"
    version = "1.0"

    [project.entry-points."cutgrammar.methods"]
    halver = "halver:HALVER"

`cutgrammar evaluate --methods halver random` then evaluates it; help, tables, pages and MLflow take what they say from
`HALVER`. A method that uses the trial's own demonstration declares `sees_demonstration=True`; tables mark it and do not
rank it, and no other method is given the demonstration.

Run: python docs/examples/05_your_own_method.py
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from cutgrammar import (
    Configuration,
    Cut,
    CutMade,
    Method,
    Plane,
    PlanningContext,
    Refusal,
    Scored,
    Settings,
    Stuck,
    canonical_frame,
    goal_for,
    run_trial,
    setup_named,
    stream,
)


class Halver:
    """Halves the largest fragment across its longest axis."""

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """The next cut; see `cutgrammar.Planner`."""
        del goal, rng
        if refused:
            return Stuck(refused[-1].reason)
        largest = max(now, key=lambda fragment: fragment.mesh.volume)
        across_longest_axis = Plane(np.array([0.0, 0.0, 1.0]), 0.0)  # in the canonical frame
        return Cut.of_fragment(largest, across_longest_axis, canonical_frame(largest.mesh))


def make_planner(context: PlanningContext) -> Halver:
    """A planner for one trial; `context` holds the trained model, settings and more, none of which is needed here."""
    del context
    return Halver()


HALVER = Method(
    "halver", make_planner, description="halves the largest fragment until there are enough", kind="control"
)


if __name__ == "__main__":
    from cutgrammar_sim import Bench, carrot, make_demonstration

    settings, streams = Settings(), partial(stream, 0, "example")
    demonstration = make_demonstration(
        0, setup_named("N1M1"), ("chunks",), {"carrot": carrot}, 0, settings.demonstrator
    )
    events = run_trial(
        demonstration.start,
        goal_for(demonstration, "scattered", streams("goal")),
        Halver(),
        Bench(settings.world.min_share),
        [],
        streams,
        settings.trial,
    )
    n_cuts = sum(isinstance(event, CutMade) for event in events)
    (scored,) = (event for event in events if isinstance(event, Scored))
    print(f"{HALVER.name} ({HALVER.description}) made {n_cuts} cuts")
    print(f"{scored.fragments} of {scored.goal_fragments} fragments, strict IoU {scored.iou_strict:.3f}")
