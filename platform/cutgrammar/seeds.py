"""Random streams keyed by their purpose, so that the order of work cannot change a result.

World and camera streams are keyed WITHOUT the method, so that methods meet the same noise (paired comparisons);
planner streams add the method, the step and the attempt.
"""

import hashlib

import numpy as np


def key_of(name: str | int) -> int:
    """A name as a 64-bit integer, the same on every machine, unlike `hash()`; numpy integers count as Python's."""
    plain = name if isinstance(name, str) else int(name)
    return int.from_bytes(hashlib.sha256(repr(plain).encode()).digest()[:8], "big")


def sequence(seed: int, *names: str | int) -> np.random.SeedSequence:
    """The seed sequence of the stream called `names` under `seed`."""
    return np.random.SeedSequence(seed, spawn_key=tuple(key_of(name) for name in names))


def stream(seed: int, *names: str | int) -> np.random.Generator:
    """The random stream called `names` under `seed`; the same names always give the same numbers.

    Example:
        >>> stream(0, "collect", 3).integers(10) == stream(0, "collect", 3).integers(10)
        True
    """
    return np.random.default_rng(sequence(seed, *names))


def torch_seed(seed: int, *names: str | int) -> int:
    """A 63-bit seed for `torch.Generator.manual_seed`, drawn from the stream called `names`."""
    return int(sequence(seed, *names).generate_state(1, np.uint64)[0] >> np.uint64(1))
