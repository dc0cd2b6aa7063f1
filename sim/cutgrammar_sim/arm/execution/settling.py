"""Samples of fragments and arm while fragments come to rest after a cut."""

from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar_sim.arm.execution.articulation import Articulation
from cutgrammar_sim.arm.execution.log import Log, still
from cutgrammar_sim.physics.bodies import TIMESTEP

SAMPLE = 4
"""Number of steps between two samples."""


class Settling:
    """Samples of fragments that settle, and of the arm, which holds its posture."""

    def __init__(self, entities: list[Any], body: Articulation) -> None:
        self._entities = entities
        self._body = body
        self._steps: list[int] = []
        self._q: list[Floats] = []
        self._qd: list[Floats] = []
        self._poses: list[list[Any]] = []

    def sample(self, step: int) -> None:
        """Take a sample after every `SAMPLE`th step."""
        if step % SAMPLE == 0:
            self._steps.append(step)
            self._q.append(self._body.positions)
            self._qd.append(self._body.velocities)
            self._poses.append([entity.get_pose() for entity in self._entities])

    @property
    def poses(self) -> Floats:
        """(k, f, 7) X_WF of the fragments at the samples."""
        numbers = np.array([[[*pose.p, *pose.q] for pose in poses] for poses in self._poses], dtype=np.float64)
        numbers[..., 3:] *= np.where(numbers[..., 3:4] < 0.0, -1.0, 1.0)
        return numbers

    def log(self, began: float, aim: Floats, number: int) -> Log:
        """Log of the arm, which holds the posture `aim` from time `began` on; the leg is `number`."""
        times = began + TIMESTEP * (1.0 + np.array(self._steps))
        return still(times, np.array(self._q), np.array(self._qd), aim, number)
