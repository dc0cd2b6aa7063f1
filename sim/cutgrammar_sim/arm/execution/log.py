"""Record of a motion: the commands to the motors and what the joints did, step by step."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints, frozen_floats
from cutgrammar_sim.arm.planning.loads import Pushes

ARRAYS = ("times", "q", "qd", "aim", "rate", "feed")


@dataclass(frozen=True, eq=False)
class Log:
    """Samples after steps of the physics.

    Attributes:
        times: (t,) [s], ascending.
        q, qd: (t, n) measured angles and velocities of the joints [rad, rad/s].
        aim, rate: (t, n) target angles, and mean target velocities in the step before [rad, rad/s].
        feed: (t, n) feed-forward torques of the motors, which are added to those of the drives [N m].
        pushes: forces on the blade in the step before.
        legs: (t,) number of the plan's leg; after the last leg the number of legs.
    """

    times: Floats
    q: Floats
    qd: Floats
    aim: Floats
    rate: Floats
    feed: Floats
    pushes: Pushes
    legs: Ints

    def __post_init__(self) -> None:
        object.__setattr__(self, "times", frozen_floats(self.times, (None,), "times"))
        for name in ARRAYS[1:]:
            object.__setattr__(self, name, frozen_floats(getattr(self, name), (len(self.times), None), name))


def still(times: Floats, q: Floats, qd: Floats, aim: Floats, leg: int) -> Log:
    """The log of an arm that holds the posture `aim` (n,)."""
    none, rest = np.zeros((len(times), 3)), np.zeros_like(q)
    return Log(times, q, qd, rest + aim, rest, rest, Pushes(none, none), np.full(len(times), leg))


def joined(logs: Sequence[Log]) -> Log:
    """Several logs as one."""
    forces = np.concatenate([log.pushes.forces_W for log in logs])
    places = np.concatenate([log.pushes.p_WP for log in logs])
    arrays = {name: np.concatenate([getattr(log, name) for log in logs]) for name in ARRAYS}
    return Log(**arrays, pushes=Pushes(forces, places), legs=np.concatenate([log.legs for log in logs]))
