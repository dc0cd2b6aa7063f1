"""The bench: a world of geometry alone, where a cut takes a millisecond and nothing moves.

Its blade is exactly as large as the section of the fragments meant, so it never touches another fragment: the paper's
object-centric cut, made by the Slice function of Section IV. Products keep the frame and pose of their parent.
"""

from collections.abc import Sequence

from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.interfaces import Cut, Done, Refused, Stream
from cutgrammar.settings import Settings
from cutgrammar_sim.worlds.division import divide


class Bench:
    """A `World` without physics; `observe` is exact."""

    def __init__(self, min_share: float) -> None:
        self._min_share = min_share
        self._now: Configuration = ()

    def reset(self, start: Configuration, foods: Sequence[str] = ()) -> None:
        """Lay out the initial configuration as it is.

        Raises:
            TypeError: a fragment is known as a point cloud only.
        """
        del foods  # the bench has no forces
        self._now = tuple(Fragment(fragment.mesh, fragment.X_WF) for fragment in start)

    def observe(self) -> Configuration:
        """The current fragments as they are."""
        return self._now

    def truth(self) -> Configuration:
        """The current fragments as they are."""
        return self._now

    def apply(self, cut: Cut) -> Done | Refused:
        """Replace the fragments meant by their products, in place."""
        divided = divide(self._now, cut, self._min_share)
        if isinstance(divided, Refused):
            return divided
        after: list[Fragment] = []
        for index, fragment in enumerate(self._now):
            if index in divided:
                after.extend(Fragment(product, fragment.X_WF) for product in divided[index].products)
            else:
                after.append(fragment)
        self._now = tuple(after)
        return Done(sum(len(sliced.products) for sliced in divided.values()))


def make_world(settings: Settings, stream: Stream) -> Bench:
    """Geometry only: a cut takes a millisecond and nothing moves. No noise is drawn from `stream`."""
    del stream
    return Bench(settings.world.min_share)
