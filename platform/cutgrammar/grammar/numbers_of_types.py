"""Which numbers of fragment types are tried: a growing grid until the objective has clearly turned, then a finer one.

Neighbouring numbers k differ less than two random starts of the clustering, so trying every k up to a given one would
both waste time and end at that one where the data hold more types.
"""

from collections.abc import Iterator, Mapping

EVERY = 16
"""Up to here every k is tried; above, the grid grows by an eighth at each step."""


def growing_grid(limit: int) -> Iterator[int]:
    """1, 2, ... `EVERY`, then steps of an eighth of k, up to `limit`, which is the last.

    Example:
        >>> list(growing_grid(40))[14:]
        [15, 16, 18, 20, 22, 24, 27, 30, 33, 37, 40]
    """
    k = 1
    while k < limit:
        yield k
        k += max(1, k // 8 if k >= EVERY else 1)
    yield limit


def has_turned(objectives: Mapping[int, float]) -> bool:
    """Whether the best k lies so far below the largest one tried that larger ones need not be tried.

    Args:
        objectives: the best objective at each k tried [nats].
    """
    best = max(objectives, key=lambda k: (objectives[k], -k))
    return max(objectives) >= 1.3 * best + 4


def between_neighbours(tried: Mapping[int, float], most: int = 8) -> list[int]:
    """At most `most` evenly spread k between the best k and its neighbours among those tried.

    Args:
        tried: the best objective at each k tried [nats].
        most: how many at most.
    """
    ks = sorted(tried)
    i = ks.index(max(ks, key=lambda k: (tried[k], -k)))
    between = [k for k in range(ks[max(i - 1, 0)], ks[min(i + 1, len(ks) - 1)]) if k not in tried]
    return between[:: -(-len(between) // most)] if between else []
