"""The events of one trial on the bench, one line each, as readable text."""

from functools import partial

import numpy as np

from cutgrammar.events import CutMade, Planned
from cutgrammar.methods.controls import ReplayPlanner
from cutgrammar.plugins import FOODS, load, reference_of
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings
from cutgrammar.trials.goals import goal_for
from cutgrammar.trials.run_trial import run_trial
from cutgrammar.trials.setups import SETUPS
from cutgrammar_sim.demonstrator.demonstrate import make_demonstration
from cutgrammar_sim.worlds.bench import Bench


def numbers(values, digits=3):
    return " ".join(f"{round(float(value), digits) + 0.0:.{digits}f}" for value in np.ravel(values))


def line_of(event):
    if isinstance(event, Planned):
        plane = event.cut.plane_W
        return (
            f"step {event.step} attempt {event.attempt} planned: normal {numbers(plane.normal)}, "
            f"offset {numbers(1e3 * plane.offset, 1)} mm, fragment at {numbers(1e3 * event.cut.p_WC, 1)} mm"
        )
    if isinstance(event, CutMade):
        volumes = sorted((fragment.mesh.volume * 1e6 for fragment in event.configuration), reverse=True)
        return f"step {event.step} cut made: {event.products} products; volumes {numbers(volumes, 1)} cm3"
    scores = ", ".join(f"{name} {'unknown' if v is None else numbers(v)}" for name, v in event.scores.items())
    return f"scored: {event.fragments} of {event.goal_fragments} fragments; {scores}"


def test_a_trial_of_replay_on_the_bench_gives_the_recorded_events(check_golden):
    settings = Settings()
    foods = {"potato": load(reference_of(FOODS, "potato"))}
    demonstration = make_demonstration(3, SETUPS["N1M2"], ("chunks", "slices"), foods, 5, settings.demonstrator)
    goal = goal_for(demonstration, "in-place", stream(5, "goal"))
    events = run_trial(
        demonstration.start,
        goal,
        ReplayPlanner(demonstration),
        Bench(settings.world.min_share),
        (),
        partial(stream, 5),
        settings.trial,
    )
    check_golden("trial.txt", "\n".join(map(line_of, events)))
