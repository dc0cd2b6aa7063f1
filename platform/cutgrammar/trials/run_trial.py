"""One trial: a planner and a world take turns until the goal's number of fragments is reached (IV-B)."""

import time
from collections.abc import Sequence

from cutgrammar.events import CutFailed, CutMade, CutRefused, Event, GaveUp, Observer, Planned
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.interfaces import Done, Failed, Planner, Refusal, SeesWithCameras, Stream, Stuck, World
from cutgrammar.settings import TrialSettings
from cutgrammar.trials.built_in_scores import COMPUTED
from cutgrammar.trials.scores import Score
from cutgrammar.trials.scoring import score


def run_trial(
    start: Configuration,
    goal: Configuration,
    planner: Planner,
    world: World,
    observers: Sequence[Observer],
    stream: Stream,
    settings: TrialSettings,
    *,
    foods: Sequence[str] = (),
    goal_seen: Configuration | None = None,
    scores: Sequence[Score] = COMPUTED,
    until: int | None = None,
) -> list[Event]:
    """Plan, cut and observe until the goal's number of fragments is reached; then score the true configuration.

    Args:
        start: the initial configuration, in the world frame.
        goal: the goal's fragments.
        planner: the method on trial.
        world: a fresh world.
        observers: called with every event as it happens.
        stream: the planner's streams of this trial, by step and attempt.
        settings: with the number of refusals in one step after which the trial ends as stuck.
        foods: name of the food of each object of `start`.
        goal_seen: the goal as the planner is given it, e.g. as point clouds; None for the goal itself.
        scores: the scores of the configuration reached.
        until: number of fragments at which the trial ends; None for that of the goal.

    Returns:
        All events, a `Scored` at the end.
    """
    events: list[Event] = []

    def emit(event: Event) -> None:
        events.append(event)
        for observer in observers:
            observer(event)

    world.reset(start, foods)
    wanted = goal if goal_seen is None else goal_seen
    step, refused = 1, list[Refusal]()
    while len(now := world.observe()) < (len(goal) if until is None else until):
        if isinstance(world, SeesWithCameras):
            emit(world.sighted(step))
        attempt = len(refused)
        if attempt >= settings.max_refusals:
            emit(GaveUp(step, f"{attempt} cuts were refused in this step, the last because {refused[-1].reason}"))
            break
        began = time.perf_counter()
        cut = planner.next_cut(now, wanted, tuple(refused), stream(step, attempt))
        if isinstance(cut, Stuck):
            emit(GaveUp(step, cut.reason))
            break
        emit(Planned(step, attempt, cut, time.perf_counter() - began))
        outcome = world.apply(cut)
        if isinstance(outcome, Done):
            emit(CutMade(step, outcome.products, world.truth(), outcome.execution, outcome.motion))
            step, refused = step + 1, []
        elif isinstance(outcome, Failed):
            emit(CutFailed(step, outcome.reason))
            break
        else:
            emit(CutRefused(step, attempt, outcome.reason))
            refused.append(Refusal(cut, outcome.reason))
    emit(score(world.truth(), goal, scores))
    return events
