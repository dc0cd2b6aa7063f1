"""When the arm is where along its path: as fast as its limits allow, from rest to rest."""

from dataclasses import dataclass

from cutgrammar.geometry.arrays import Floats, frozen_floats

STEP = 1.0 / 240.0
"""Between two samples of a trajectory: the step of the physics [s]."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A timed movement of the joints, at rest at both ends.

    Attributes:
        times: (t,) from 0, one `STEP` apart [s].
        positions, velocities, accelerations: (t, n) of the joints [rad, rad/s, rad/s2].
    """

    times: Floats
    positions: Floats
    velocities: Floats
    accelerations: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "times", frozen_floats(self.times, (None,), "times"))
        for name in ("positions", "velocities", "accelerations"):
            object.__setattr__(self, name, frozen_floats(getattr(self, name), (len(self.times), None), name))

    @property
    def seconds(self) -> float:
        """How long it lasts [s]."""
        return float(self.times[-1])
