"""A random stream for compiled code: SplitMix64, seeded from a numpy generator; it is the same on every machine."""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

State = NDArray[np.uint64]
"""(1,) state of a compiled stream; every draw updates it in place."""

Compiled = Any
"""Arguments and results of compiled functions, whose types numba infers."""


def draws_from(rng: np.random.Generator) -> State:
    """A new compiled stream, seeded from `rng` and independent of it afterwards."""
    return rng.integers(0, 2**64, size=1, dtype=np.uint64)


@njit(cache=True)
def uniform(state: Compiled) -> float:
    """Draw a number from [0, 1)."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit(cache=True)
def below(state: Compiled, n: int) -> int:
    """Draw an integer from 0 to n - 1."""
    return min(int(uniform(state) * n), n - 1)
