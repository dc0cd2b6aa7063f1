"""6. Towards a real arm: a driver is a `World` that rehearses each cut in simulation and plays it on a controller.

The controller here is a mock that refuses what a real controller must refuse; put yours in its place. See
docs/real_arm.md for safety.
Run: python docs/examples/06_towards_a_real_arm.py [FOLDER]
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from cutgrammar import (
    Configuration,
    Cut,
    CutMade,
    CutTrajectory,
    Done,
    Failed,
    Limits,
    Plane,
    Planned,
    Refused,
    Settings,
    Trajectory,
    canonical_frame,
    setup_named,
    trajectory_from_json,
    trajectory_of,
    trajectory_to_json,
)
from cutgrammar_sim import KinovaWorld, carrot, make_demonstration

START_TOLERANCE = 0.02
"""Largest difference between a joint's position and the start of a trajectory [rad]."""


class StoppedError(Exception):
    """The controller stopped the arm."""


class MockController:
    """Takes one set point a millisecond, as a real controller does, and stops at any that would harm the arm."""

    period = 0.001

    def __init__(self, positions: np.ndarray, limits: Limits) -> None:
        self.positions, self.gripper_closed, self._limits = positions, False, limits
        self.turns_freely = np.isinf(limits.positions).all(axis=1)

    def set_point(self, positions: np.ndarray, efforts: np.ndarray) -> None:
        """Move the joints to `positions`; `efforts` are the torques expected there."""
        velocities = (positions - self.positions) / self.period
        for what, values, low, high in (
            ("position", positions, *self._limits.positions.T),
            ("velocity", velocities, -1.02 * self._limits.velocities, 1.02 * self._limits.velocities),
            ("effort", efforts, -self._limits.efforts, self._limits.efforts),
        ):
            if ((values < low) | (values > high)).any():
                raise StoppedError(f"a {what} of {values.round(3).tolist()} is beyond a limit")
        self.positions = positions


def play(cut: CutTrajectory, controller: MockController) -> None:
    """Let the controller carry out one cut.

    Raises:
        StoppedError: the arm is not where the cut begins, or the controller stopped.
    """
    difference = cut.positions[0] - controller.positions
    turns = np.where(controller.turns_freely, np.round(difference / (2.0 * np.pi)) * 2.0 * np.pi, 0.0)
    if np.abs(difference - turns).max() > START_TOLERANCE:
        raise StoppedError(f"cut {cut.step} begins {np.abs(difference - turns).max():.3f} rad from the arm's position")
    path = CubicHermiteSpline(cut.times, cut.positions - turns, cut.velocities)
    phase_starts = np.array([start for _, start in cut.phases])
    controller.positions = cut.positions[0] - turns
    for t in np.arange(cut.times[0], cut.times[-1], controller.period):
        phase = cut.phases[int(np.searchsorted(phase_starts, t, side="right")) - 1][0]
        controller.gripper_closed = phase in ("carry", "place")  # closes at the end of "pick", opens after "place"
        sample = min(int(np.searchsorted(cut.times, t)), len(cut.times) - 1)
        controller.set_point(path(t), cut.efforts[sample])


class MockBoard:
    """Replaces the real board and the cameras above it."""

    def __init__(self, fragments: Configuration) -> None:
        self.fragments = fragments

    def perceive(self) -> Configuration:
        """The fragments on the board, as closed meshes in W."""
        return self.fragments


class ArmDriver:
    """A `World` whose cuts a real arm makes.

    Args:
        settings: settings of the rehearsal.
        controller: controller of the arm.
        board: the board that the cameras see.
    """

    def __init__(self, settings: Settings, controller: MockController, board: MockBoard) -> None:
        self._settings, self._controller, self._board = settings, controller, board
        self._now: Configuration = ()
        self._foods: tuple[str, ...] = ()
        self.played: list[Trajectory] = []

    def reset(self, start: Configuration, foods: Sequence[str] = ()) -> None:
        """Check what a person has laid on the board; its true poses are perceived, not assumed."""
        self._foods = tuple(foods)
        self._now = self._board.perceive()
        if len(self._now) != len(start):
            raise ValueError(
                f"the cameras see {len(self._now)} objects on the board; the trial starts with {len(start)}"
            )

    def observe(self) -> Configuration:
        """The fragments that the cameras see now."""
        self._now = self._board.perceive()
        return self._now

    def truth(self) -> Configuration:
        """The fragments perceived last: the true ones are not known here."""
        return self._now

    def apply(self, cut: Cut) -> Done | Refused | Failed:
        """Rehearse the cut, check it, play it."""
        rehearsal = KinovaWorld(self._settings)
        rehearsal.reset(self._now, self._foods if len(self._foods) == len(self._now) else ())
        outcome = rehearsal.apply(cut)
        if not isinstance(outcome, Done):
            return Refused(outcome.reason)  # whatever went wrong, it was a rehearsal: the real arm has not moved
        events = [Planned(1, 0, cut, 0.0), CutMade(1, 2, rehearsal.truth(), outcome.execution, outcome.motion)]
        trajectory = trajectory_of(events, "a cut", rehearsal.arm.name)
        assert trajectory is not None
        if violations := trajectory.violations():
            return Refused(violations[0])
        try:
            play(trajectory.cuts[0], self._controller)
        except StoppedError as error:
            return Failed(str(error))
        self.played.append(trajectory)
        self._board.fragments = rehearsal.truth()  # on a real board the knife has done this
        return outcome


folder, settings = Path(sys.argv[1] if len(sys.argv) > 1 else "example"), Settings()
demonstration = make_demonstration(0, setup_named("N1M1"), ("chunks",), {"carrot": carrot}, 0, settings.demonstrator)
simulated = KinovaWorld(settings)
simulated.reset(demonstration.start, demonstration.foods)
board = MockBoard(simulated.truth())
joints = simulated.arm.joints
limits = Limits(
    np.array([[joint.low, joint.high] for joint in joints]),
    np.array([joint.velocity for joint in joints]),
    np.array([joint.torque for joint in joints]),
)
driver = ArmDriver(settings, MockController(np.array(simulated.arm.home), limits), board)
driver.reset(demonstration.start, demonstration.foods)
for _ in range(2):
    largest = max(driver.observe(), key=lambda fragment: fragment.mesh.volume)
    X_WC = largest.X_WF @ canonical_frame(largest.mesh)
    print(driver.apply(Cut(Plane.through(X_WC.position, X_WC.rotation[:, 2]), largest.p_WC[None])))
folder.mkdir(exist_ok=True)
file = folder / "cut.json"
file.write_bytes(trajectory_to_json(driver.played[0]))
again = trajectory_from_json(file.read_bytes(), str(file))
play(again.cuts[0], MockController(np.array(simulated.arm.home), again.limits))
print(f"{len(driver.played)} cuts were played; {file} holds the first, which was read back and played once more")
