"""6. Towards a real arm: a driver is a `World`; it rehearses each cut in simulation and plays it into a controller.

The controller here is a mock that refuses what a real one must refuse; put yours in its place. docs/real_arm.md tells
what to mind.
Run: python docs/examples/06_towards_a_real_arm.py [FOLDER]
"""

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from cutgrammar.events import CutMade, Planned
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.geometry.plane import Plane
from cutgrammar.interfaces import Cut, Done, Failed, Refused
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings
from cutgrammar.trials.setups import setup_called
from cutgrammar.trials.trajectory import CutTrajectory, Limits, Trajectory, from_json, to_json, trajectory_of
from cutgrammar_sim.demonstrator.demonstrate import make_demonstration
from cutgrammar_sim.foods import carrot
from cutgrammar_sim.worlds.kinova import make_world

NEAR = 0.02
"""How far each joint may be from where a trajectory begins [rad]."""


class StoppedError(Exception):
    """The controller refuses to go on."""


class MockController:
    """Takes set points as a real controller does, a thousand a second, and stops at what would harm the arm."""

    period = 0.001

    def __init__(self, posture: np.ndarray, limits: Limits) -> None:
        self.posture, self.gripper_holds, self._limits = posture, False, limits

    def set_point(self, positions: np.ndarray, efforts: np.ndarray) -> None:
        """One set point; `efforts` are what the joints are expected to bear."""
        velocities = (positions - self.posture) / self.period
        for what, values, low, high in (
            ("position", positions, *self._limits.positions.T),
            ("velocity", velocities, -1.02 * self._limits.velocities, 1.02 * self._limits.velocities),
            ("effort", efforts, -self._limits.efforts, self._limits.efforts),
        ):
            if ((values < low) | (values > high)).any():
                raise StoppedError(f"a {what} of {values.round(3).tolist()} is beyond a limit")
        self.posture = positions


def play(cut: CutTrajectory, controller: MockController) -> None:
    """Let the controller carry out one cut.

    Raises:
        StoppedError: the arm is not where the cut begins, or the controller stopped.
    """
    away = np.abs(cut.positions[0] - controller.posture).max()
    if away > NEAR:
        raise StoppedError(f"cut {cut.step} begins {away:.3f} rad from where the arm is")
    way = CubicHermiteSpline(cut.times, cut.positions, cut.velocities)
    begins = np.array([begin for _, begin in cut.phases])
    controller.posture = cut.positions[0]
    for t in np.arange(cut.times[0], cut.times[-1], controller.period):
        phase = cut.phases[int(np.searchsorted(begins, t, side="right")) - 1][0]
        controller.gripper_holds = phase in ("carry", "place")  # needles out at the end of "pick", in after "place"
        nearest = min(int(np.searchsorted(cut.times, t)), len(cut.times) - 1)
        controller.set_point(way(t), cut.efforts[nearest])


class MockBoard:
    """Stands for the real board and the cameras above it."""

    def __init__(self, lies: Configuration) -> None:
        self.lies = lies

    def perceive(self) -> Configuration:
        """The fragments that lie there, as closed meshes in W."""
        return self.lies


class ArmDriver:
    """A `World` whose cuts a real arm makes.

    Args:
        settings: of the rehearsal.
        controller: of the arm.
        board: what is looked at.
    """

    def __init__(self, settings: Settings, controller: MockController, board: MockBoard) -> None:
        self._settings, self._controller, self._board = settings, controller, board
        self._now: Configuration = ()
        self._foods: tuple[str, ...] = ()
        self.played: list[Trajectory] = []

    def reset(self, start: Configuration, foods: Sequence[str] = ()) -> None:
        """A person lays the objects on the board; where they truly lie is seen, not assumed."""
        self._foods = tuple(foods)
        self._now = self._board.perceive()
        if len(self._now) != len(start):
            raise ValueError(f"{len(self._now)} objects are seen on the board, and {len(start)} should lie there")

    def observe(self) -> Configuration:
        """What the cameras see now."""
        self._now = self._board.perceive()
        return self._now

    def truth(self) -> Configuration:
        """For scoring: nobody knows it here, so what was seen last stands for it."""
        return self._now

    def apply(self, cut: Cut) -> Done | Refused | Failed:
        """Rehearse the cut, check it, play it."""
        rehearsal = make_world(self._settings, partial(stream, 0, "rehearsal"))
        rehearsal.reset(self._now, self._foods if len(self._foods) == len(self._now) else ())
        outcome = rehearsal.apply(cut)
        if not isinstance(outcome, Done):
            return Refused(outcome.reason)  # nothing has moved yet, whatever went wrong in the rehearsal
        told = [Planned(1, 0, cut, 0.0), CutMade(1, 2, rehearsal.truth(), outcome.execution, outcome.motion)]
        trajectory = trajectory_of(told, "a cut", rehearsal.arm.name)
        assert trajectory is not None
        if broken := trajectory.violations():
            return Refused(broken[0])
        try:
            play(trajectory.cuts[0], self._controller)
        except StoppedError as error:
            return Failed(str(error))
        self.played.append(trajectory)
        self._board.lies = rehearsal.truth()  # on a real board the knife has done this
        return outcome


folder, settings = Path(sys.argv[1] if len(sys.argv) > 1 else "example"), Settings()
demonstration = make_demonstration(0, setup_called("N1M1"), ("chunks",), {"carrot": carrot}, 0, settings.demonstrator)
simulated = make_world(settings, partial(stream, 0, "example"))
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
    middle = largest.X_WF @ canonical_frame(largest.mesh)
    print(driver.apply(Cut(Plane.through(middle.position, middle.rotation[:, 2]), largest.p_WC[None])))
folder.mkdir(exist_ok=True)
file = folder / "cut.json"
file.write_bytes(to_json(driver.played[0]))
again = from_json(file.read_bytes(), str(file))
play(again.cuts[0], MockController(np.array(simulated.arm.home), again.limits))
print(f"{len(driver.played)} cuts were played; {file} holds the first, which was read back and played once more")
