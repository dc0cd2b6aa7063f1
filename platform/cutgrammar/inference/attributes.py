"""What `grammar-plus` adds to Eq. (3): attributes of nodes that follow from the goal's fragments grounded below them.

    log p(volume | tree) = sum over nodes v with grounded terminals of log p(V_v | c_v)
                         + sum over current fragments i of log N(log V_i; log V_root(i), conservation)

V_v is the summed volume of the goal's fragments grounded at or below v: cutting changes no volume. p(V | c) is a
log-normal around the training fragments of type c, mixed with a background so that an unusual fragment does not decide
alone. The second line is exact physics up to perception: what is grounded below a current fragment must come out of it.

With `log_whole` the prior of Eq. (4) also holds the choice between terminal and production: p(whole | c) for a terminal
of type c, 1 - p(whole | c) for a node that is expanded.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats, Ints, frozen_floats
from cutgrammar.inference.draws import Compiled
from cutgrammar.inference.parse_tree import START, ParseTree

BACKGROUND = 0.02
"""Share of the background in p(V | c)."""
BACKGROUND_RANGE = 10.0
"""Width of the background, a uniform density over log volumes."""


@dataclass(frozen=True, eq=False)
class Attributes:
    """Attributes of the goal's and the current fragments, and what each type expects of them.

    Attributes:
        goal_volumes: (g,) volumes of the goal's fragments [m3].
        current_volumes: (m,) volumes of the current fragments [m3].
        log_volume: (k,) mean log volume of each type [log m3].
        log_volume_std: (k,) its standard deviation.
        volume_weight: factor of log p(V | c); 0 leaves it out.
        conservation: standard deviation of the log ratio of a current fragment's volume to that of its terminals; 0
            leaves the term out.
        log_whole: (k,) log probability that a fragment of the type stays whole; None leaves the choice out of Eq. (4).
        layout: whether the goal's layout enters the posterior.
        swap_types: whether the annealing may swap the fragments of terminals of different types.

    Raises:
        ValueError: arrays do not match, or a number is out of range.
    """

    goal_volumes: Floats
    current_volumes: Floats
    log_volume: Floats
    log_volume_std: Floats
    volume_weight: float = 1.0
    conservation: float = 0.1
    log_whole: Floats | None = None
    layout: bool = True
    swap_types: bool = True

    def __post_init__(self) -> None:
        k = len(self.log_volume)
        object.__setattr__(self, "goal_volumes", frozen_floats(self.goal_volumes, (None,), "goal_volumes"))
        object.__setattr__(self, "current_volumes", frozen_floats(self.current_volumes, (None,), "current_volumes"))
        object.__setattr__(self, "log_volume", frozen_floats(self.log_volume, (k,), "log_volume"))
        object.__setattr__(self, "log_volume_std", frozen_floats(self.log_volume_std, (k,), "log_volume_std"))
        if self.log_whole is not None:
            object.__setattr__(self, "log_whole", frozen_floats(self.log_whole, (k,), "log_whole"))
        if not min(self.goal_volumes.min(), self.current_volumes.min(), self.log_volume_std.min()) > 0.0:
            raise ValueError("volumes and standard deviations of volumes must be positive")
        if self.volume_weight < 0.0 or self.conservation < 0.0:
            raise ValueError("volume_weight and conservation must not be negative")

    def __reduce__(self) -> tuple[Any, ...]:
        return Attributes, (
            self.goal_volumes,
            self.current_volumes,
            self.log_volume,
            self.log_volume_std,
            self.volume_weight,
            self.conservation,
            self.log_whole,
            self.layout,
            self.swap_types,
        )

    def ordered(self, order: Ints) -> "Attributes":
        """The same with the goal's fragments in another order (g,)."""
        return replace(self, goal_volumes=self.goal_volumes[order])

    def part(self, i: int, goals: Ints) -> "Attributes":
        """Those of current fragment i and of the goal's fragments `goals` (n,) alone."""
        return replace(self, goal_volumes=self.goal_volumes[goals], current_volumes=self.current_volumes[[i]])

    @property
    def log_terminal(self) -> Floats:
        """(g, k) weighted log p(V | c) of each of the goal's fragments as a terminal of each type."""
        densities = np.array(
            [
                [_log_density(np.log(v), m, s) for m, s in zip(self.log_volume, self.log_volume_std, strict=True)]
                for v in self.goal_volumes
            ]
        )
        return np.asarray(self.volume_weight * densities)

    @property
    def compiled(self) -> tuple[Any, ...]:
        """The arrays and numbers that `log_of_volume` takes."""
        return (
            np.log(self.current_volumes),
            self.log_volume,
            self.log_volume_std,
            float(self.volume_weight),
            float(self.conservation),
        )


def log_volume(tree: ParseTree, grounding: Ints, attributes: Attributes) -> float:
    """The volume term of a grounded tree (see the module).

    Args:
        tree: the parse tree.
        grounding: (t,) index of each terminal's fragment, or a negative number.
        attributes: volumes of the goal and the current fragments, and those that the types expect.
    """
    volumes = node_volumes(tree, grounding, attributes.goal_volumes)
    fragment, total = -1, 0.0
    for node, volume in enumerate(volumes):
        fragment += int(tree.parents[node] == START)
        root = fragment if tree.parents[node] == START else -1
        total += log_of_volume(volume, tree.types[node], root, attributes.compiled)
    return total


def log_stays(tree: ParseTree, attributes: Attributes) -> float:
    """Log probability of all choices between terminal and production; 0 where they are left out."""
    log_whole = attributes.log_whole
    if log_whole is None:
        return 0.0
    terminal = np.zeros(len(tree.types), dtype=bool)
    terminal[tree.terminals] = True
    cut = np.log(-np.expm1(log_whole))
    return float(log_whole[tree.types[terminal]].sum() + cut[tree.types[~terminal]].sum())


def node_volumes(tree: ParseTree, grounding: Ints, goal_volumes: Floats) -> Floats:
    """(n,) summed volume of the fragments grounded at or below every node [m3]."""
    volumes = np.zeros(len(tree.types))
    grounded = grounding >= 0
    volumes[tree.terminals[grounded]] = goal_volumes[grounding[grounded]]
    for node in range(len(volumes) - 1, -1, -1):  # in preorder, children come after their parents
        if tree.parents[node] != START:
            volumes[tree.parents[node]] += volumes[node]
    return volumes


@njit(cache=True)
def log_of_volume(volume: float, c: int, root: int, compiled: Compiled) -> float:
    """The term of one node of volume `volume` and type c; `root` is its current fragment, or -1 below these."""
    log_current, mean, std, weight, conservation = compiled
    if volume <= 0.0:
        return 0.0
    log_volume = np.log(volume)
    total = 0.0
    if weight > 0.0:
        total += weight * _log_density(log_volume, mean[c], std[c])
    if root >= 0 and conservation > 0.0:
        total -= 0.5 * ((log_volume - log_current[root]) / conservation) ** 2
    return total


@njit(cache=True)
def _log_density(log_volume: float, mean: float, std: float) -> float:
    """Log p(V | c) over log volumes."""
    x = (log_volume - mean) / std
    near = (1.0 - BACKGROUND) * np.exp(-0.5 * x * x) / (std * np.sqrt(2.0 * np.pi))
    log_density: float = np.log(near + BACKGROUND / BACKGROUND_RANGE)
    return log_density
