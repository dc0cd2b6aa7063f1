"""Which trials an evaluation carries out: test trials x goal conditions x methods x runs."""

from collections.abc import Iterable, Sequence

from cutgrammar.errors import InputError
from cutgrammar.learning.model import Model
from cutgrammar.methods.registry import find_method
from cutgrammar.plugins import METHODS, names_in
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.run_folder import RunFacts
from cutgrammar.storage.split import Split
from cutgrammar.trials.donors import DonorPool
from cutgrammar.trials.goals import FOREIGN, GOALS
from cutgrammar.trials.record import TrialKey
from cutgrammar.trials.setups import SETUPS, setup_named
from cutgrammar_pipelines.config import EvaluateConfig
from cutgrammar_pipelines.stages.evaluate.people import People
from cutgrammar_pipelines.stages.progress import note, status


def methods_of(config: EvaluateConfig) -> tuple[str, ...]:
    """The methods to evaluate, each once; by default all, of which those of people only where people are given.

    Raises:
        InputError: a method of people is named and no people are given, or the other way round.
    """
    known = config.methods or names_in(METHODS)
    people = [method for method in known if find_method(method).is_person]
    if config.methods and people and not config.human:
        raise InputError(
            f"--methods {people[0]} needs what people cut: give the folders that cutgrammar record --reproduce "
            f"{config.data} made, as --human FOLDER ..."
        )
    if config.human and not people:
        raise InputError("--human gives what people cut, but no method uses it; add human to --methods")
    return tuple(dict.fromkeys(method for method in known if config.human or method not in people))


def donor_pool(source: DataSet, split: Split, models: Iterable[Model], seed: int) -> DonorPool:
    """The donors of foreign goals: test trials and, where these have none, trials that are not in the split.

    Args:
        source: the data set.
        split: which of its trials train and test.
        models: the trained models; the trials that they were trained on are no donors either.
        seed: of the evaluation.
    """
    here = [model.provenance.trials for model in models if model.provenance.data == source.digest]
    trained = set(split.train).union(*here)
    outside = {summary.trial for summary in source.trials}.difference(trained, split.test)
    return DonorPool(source.demonstration, set(split.test) - trained, outside, seed)


def plan_trials(
    config: EvaluateConfig,
    source: DataSet,
    split: Split,
    models: Sequence[Model],
    facts: RunFacts,
    donors: DonorPool,
    people: People,
) -> list[TrialKey]:
    """The keys of all trials, in the order in which they are carried out.

    Trials of deterministic methods on the bench have one run, the first, which stands for all. Those of people have one
    for each reproduction of their goal, whatever the number of runs and models.

    Args:
        config: what the evaluation is asked to do.
        source: the data set.
        split: which of its trials test.
        models: the trained models; of several, run r uses the model r.
        facts: what the trials of the run have in common.
        donors: finds the donors of foreign goals.
        people: who reproduced which goals.

    Raises:
        InputError: a setup has no test trials, people are evaluated and did none of them, no method applies to the goal
            conditions, a goal has fewer fragments than its start, a model was trained on a test trial, or a foreign
            goal has no donor.
    """
    methods, conditions = methods_of(config), tuple(dict.fromkeys(config.goals))
    applicable = applicable_goals(methods, conditions)
    by_hand = {method for method in methods if find_method(method).is_person}
    once = {method for method in methods if _needs_one_run(method, config)}
    trials = _test_trials(source, split, models, config.setups, config.trials)
    for condition in filter(FOREIGN.__contains__, conditions):
        for trial in trials:
            donors.choose(source.summary(trial).setup, trial, condition)
    if by_hand:
        _state_what_people_did(people, trials)
    world = config.world, config.perception
    planned = [
        TrialKey(source.summary(trial).setup, trial, condition, method, run, *world, facts.origin_of(run))
        for run in range(config.n_runs)
        for trial in trials
        for condition in conditions
        for method in methods
        if condition in applicable[method] and method not in by_hand and (run == 0 or method not in once)
    ]
    return planned + [
        TrialKey(source.summary(trial).setup, trial, condition, method, number, *world, facts.origin_of(0))
        for trial in trials
        for condition in conditions
        for method in methods
        if condition in applicable[method] and method in by_hand
        for number in people.reproductions(trial)
    ]


def _state_what_people_did(people: People, trials: Sequence[int]) -> None:
    """Print how many of the test trials people reproduced.

    Raises:
        InputError: none.
    """
    done = [len(people.reproductions(trial)) for trial in trials if people.reproductions(trial)]
    if not done:
        raise InputError(
            f"nobody reproduced one of these {len(trials)} goals; choose other --setups, or more --trials, or let "
            "people do them with cutgrammar record --reproduce"
        )
    status(f"people: {len(done)} of {len(trials)} goals reproduced, {sum(done)} times in all")


def _needs_one_run(method: str, config: EvaluateConfig) -> bool:
    """Whether all runs of a trial would be the same: nothing is left to chance by method, world and perception."""
    return find_method(method).is_deterministic and (config.world, config.perception) == ("bench", "truth")


def applicable_goals(methods: Sequence[str], conditions: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """The goal conditions, of `conditions`, to which each method applies.

    Raises:
        InputError: no method applies to any of them.
    """
    found = {}
    for method in methods:
        found[method] = tuple(filter(find_method(method).applies_to, conditions))
        if left_out := [condition for condition in conditions if condition not in found[method]]:
            note(f"NOTE {method} does not apply to {', '.join(left_out)} goals and is not evaluated on them")
    if not any(found.values()):
        raise InputError(
            f"{', '.join(methods)} cannot be evaluated on {', '.join(conditions)} goals, to which it does not apply; "
            f"give other goals ({', '.join(GOALS)}) or other methods"
        )
    return found


def _test_trials(
    source: DataSet, split: Split, models: Sequence[Model], setups: Sequence[str] | None, max_trials: int | None
) -> list[int]:
    """The numbers of the test trials, setup by setup."""
    of_setup: dict[str, list[int]] = {name: [] for name in SETUPS}
    for number in sorted(split.test):
        summary = source.summary(number)
        of_setup[setup_named(summary.setup).name].append(number)
        if summary.fragments < len(summary.foods):
            raise InputError(
                f"trial {number} of {source.path}: its goal has {summary.fragments} fragments and its start "
                f"{len(summary.foods)}; cutting makes more, never fewer: leave this trial out of the split"
            )
    with_tests = [name for name, numbers in of_setup.items() if numbers]
    wanted = with_tests if setups is None else list(dict.fromkeys(setups))
    for name in wanted:
        if name not in with_tests:
            raise InputError(
                f"setup {name} has no test trials in split {split.name!r} of {source.path}; "
                f"setups with test trials: {', '.join(with_tests)}"
            )
    chosen = [number for name in wanted for number in of_setup[name][:max_trials]]
    for model in models:
        if model.provenance.data == source.digest and (seen := set(chosen) & set(model.provenance.trials)):
            raise InputError(
                f"trial {min(seen)} is a test trial of split {split.name!r}, but the model was trained on it; "
                f"use the split {model.provenance.split!r}, or train on this one"
            )
    return chosen
