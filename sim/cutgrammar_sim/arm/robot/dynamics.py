"""Torques that an arm's motors need to move or to hold the arm and what is fixed to its flange."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio

from cutgrammar.geometry.arrays import Floats, frozen_floats
from cutgrammar_sim.arm.robot.description import Arm
from cutgrammar_sim.arm.robot.kinematics import as_postures
from cutgrammar_sim.arm.robot.pinocchio_model import model_of

GRAVITY = 9.81
"""Acceleration along -z of A [m/s2]; Pinocchio's default as well."""


@dataclass(frozen=True, eq=False)
class Load:
    """A rigid body that is fixed to the flange: a tool, or the fragment that it carries.

    Attributes:
        mass: [kg].
        p_TC: (3,) centre of mass in T [m].
        inertia: (3, 3) about the centre of mass, axes of T [kg m2].
    """

    mass: float
    p_TC: Floats
    inertia: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "p_TC", frozen_floats(self.p_TC, (3,), "p_TC"))
        object.__setattr__(self, "inertia", frozen_floats(self.inertia, (3, 3), "inertia"))


def inverse_dynamics(arm: Arm, q: Floats, qd: Floats, qdd: Floats, loads: Iterable[Load] = ()) -> Floats:
    """Torques of the motors for a motion against gravity, by Pinocchio's recursive Newton-Euler algorithm.

    Args:
        arm: the arm.
        q: (t, n) joint angles [rad].
        qd: (t, n) joint velocities [rad/s].
        qdd: (t, n) joint accelerations [rad/s2].
        loads: bodies fixed to the flange.

    Returns:
        (t, n) [N m].

    Raises:
        ValueError: arrays that do not have one column for each joint.
    """
    model, data = _loaded(arm, tuple(loads))
    rows = zip(*(as_postures(arm, array) for array in (q, qd, qdd)), strict=True)
    return np.array([pinocchio.rnea(model, data, *row) for row in rows]).reshape(-1, len(arm.joints))


def gravity_torques(arm: Arm, q: Floats, loads: Iterable[Load] = ()) -> Floats:
    """(t, n) torques with which the motors hold the arm and its loads still, for the postures q (t, n) [rad, N m]."""
    model, data = _loaded(arm, tuple(loads))
    return np.array([pinocchio.computeGeneralizedGravity(model, data, row) for row in as_postures(arm, q)])


@lru_cache(maxsize=16)
def _loaded(arm: Arm, loads: tuple[Load, ...]) -> tuple[Any, Any]:
    """Pinocchio's model and data of the arm with loads on its flange."""
    plain = model_of(arm)
    if not loads:
        return plain.model, plain.data
    model = plain.model.copy()
    for load in loads:
        model.appendBodyToJoint(plain.last, pinocchio.Inertia(load.mass, load.p_TC, load.inertia), plain.X_LT)
    return model, model.createData()
