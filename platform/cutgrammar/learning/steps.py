"""The steps of training trials as arrays: current fragments, goal fragments, the fragment cut and its plane (IV-B1)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.plane import Plane


@dataclass(frozen=True, eq=False)
class Steps:
    """The steps of one or more trials; the steps of a trial follow one another.

    Attributes:
        z: (n, 4, 17) shape features of all fragments, under each of `FLIPS`.
        now: for each of the m steps, the numbers of the fragments that existed before it, ascending.
        goal: likewise the final configuration of the step's trial.
        cut: (m,) the fragment that was cut.
        after: (m,) number of the trial's next step, -1 where the cut reached the goal.
        trials: (m,) the trial of each step.
        planes_C: the planes, in the canonical frame of the fragment cut [m].
    """

    z: Floats
    now: tuple[Ints, ...]
    goal: tuple[Ints, ...]
    cut: Ints
    after: Ints
    trials: Ints
    planes_C: tuple[Plane, ...]

    def __len__(self) -> int:
        return len(self.cut)

    @property
    def fragments(self) -> Ints:
        """Numbers of the fragments that take part in any step, now or in the goal."""
        return np.unique(np.concatenate([*self.now, *self.goal]))

    @property
    def mean_goal_size(self) -> float:
        """Mean number of fragments in a step's goal."""
        return float(np.mean([len(goal) for goal in self.goal]))

    @property
    def of_whole_objects(self) -> Ints:
        """Numbers of the steps that cut a whole object, which existed when the trial began."""
        starts = {int(trial): row for row, trial in reversed(list(enumerate(self.trials)))}
        whole = [cut in self.now[starts[int(trial)]] for cut, trial in zip(self.cut, self.trials, strict=True)]
        return np.flatnonzero(whole)

    def of(self, rows: Ints) -> "Steps":
        """The steps with these numbers, ascending; they must comprise whole trials."""
        number = np.full(len(self) + 1, -1)  # the last entry stands for "no next step"
        number[rows] = np.arange(len(rows))
        return Steps(
            self.z,
            tuple(self.now[row] for row in rows),
            tuple(self.goal[row] for row in rows),
            self.cut[rows],
            number[self.after[rows]],
            self.trials[rows],
            tuple(self.planes_C[row] for row in rows),
        )


def steps_of(z: Floats, trials: Sequence[int], cuts: Iterable[tuple[int, tuple[int, ...], Any]]) -> Steps:
    """The steps of the trials that the cuts belong to.

    Args:
        z: (n, 4, 17) shape features of all fragments, under each of `FLIPS`.
        trials: (n,) the trial each fragment comes from.
        cuts: (fragment cut, fragments it became, the cut with its `plane_C`), in the order they were made.

    Raises:
        ValueError: no cuts, or a cut of a fragment that does not exist at that step.
    """
    of_trial: dict[int, list[tuple[int, tuple[int, ...], Plane]]] = {}
    for fragment, made, cut in cuts:
        of_trial.setdefault(trials[fragment], []).append((fragment, made, cut.plane_C))
    if not of_trial:
        raise ValueError("no cuts make no steps; at least one is needed")
    own: dict[int, list[int]] = {}
    for fragment, owner in enumerate(trials):
        own.setdefault(owner, []).append(fragment)
    now: list[Ints] = []
    goal: list[Ints] = []
    after: list[int] = []
    for trial, made_cuts in of_trial.items():
        alive = set(own[trial]).difference(*(made for _, made, _ in made_cuts))
        for fragment, made, _ in made_cuts:
            if fragment not in alive:
                raise ValueError(f"fragment {fragment} of trial {trial} was cut where it did not exist")
            now.append(np.array(sorted(alive)))
            alive.remove(fragment)
            alive.update(made)
        goal += [np.array(sorted(alive))] * len(made_cuts)
        after += [*range(len(now) - len(made_cuts) + 1, len(now)), -1]
    rows = [(fragment, plane, trial) for trial, made_cuts in of_trial.items() for fragment, _, plane in made_cuts]
    return Steps(
        z,
        tuple(now),
        tuple(goal),
        np.array([fragment for fragment, _, _ in rows]),
        np.array(after),
        np.array([trial for _, _, trial in rows]),
        tuple(plane for _, plane, _ in rows),
    )
