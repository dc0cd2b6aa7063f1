"""5. Your own method: anything with `next_cut` is a planner, and meets the same trials and scores.

Installed under the entry point group "cutgrammar.methods", `make_halver` would be `--methods halver`.
Run: python docs/examples/05_your_own_method.py
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from cutgrammar.demonstration import Demonstration
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.geometry.plane import Plane
from cutgrammar.interfaces import Cut, ParallelMap, Refusal, Stuck, run_serially
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings
from cutgrammar.trials.goals import goal_for
from cutgrammar.trials.run_trial import run_trial
from cutgrammar.trials.setups import setup_called
from cutgrammar_sim.demonstrator.demonstrate import make_demonstration
from cutgrammar_sim.foods import carrot
from cutgrammar_sim.worlds.bench import make_world


class Halver:
    """Halves the largest fragment across its longest axis."""

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """See `cutgrammar.interfaces.Planner`."""
        del goal, rng
        if refused:
            return Stuck(refused[-1].reason)
        largest = max(now, key=lambda fragment: fragment.mesh.volume)
        X_WC = largest.X_WF @ canonical_frame(largest.mesh)
        return Cut(Plane.through(X_WC.position, X_WC.rotation[:, 2]), largest.p_WC[None])


def make_halver(
    model: object,
    settings: Settings,
    demonstration: Demonstration | None = None,
    parallel_map: ParallelMap = run_serially,
) -> Halver:
    """The factory that the entry point names."""
    del model, settings, demonstration, parallel_map
    return Halver()


settings, streams = Settings(), partial(stream, 0, "example")
demonstration = make_demonstration(0, setup_called("N1M1"), ("chunks",), {"carrot": carrot}, 0, settings.demonstrator)
events = run_trial(
    demonstration.start,
    goal_for(demonstration, "scattered", streams("goal")),
    make_halver(None, settings),
    make_world(settings, streams),
    [],
    streams,
    settings.trial,
)
print(f"{len(events)} events; the last: {events[-1]}")
