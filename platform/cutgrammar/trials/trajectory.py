"""Export of the joint trajectories of a trial to a real arm, as JSON and as YAML for ROS.

The JSON file contains a whole trial: the limits, and for each cut its plane, how the fragment was moved before, the
phases and the points. The YAML file has one document per cut with the fields of ROS's
`trajectory_msgs/JointTrajectory`. Both are described in `docs/real_arm.md`.
"""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cutgrammar.errors import InputError
from cutgrammar.events import CutMade, Event, Planned
from cutgrammar.geometry.arrays import Floats, frozen_floats
from cutgrammar.geometry.plane import Plane
from cutgrammar.untrusted import parse_json, shortened

FORMAT = "cutgrammar trajectory"
SCHEMA = 1
UNITS = {"time": "s", "position": "rad", "velocity": "rad/s", "effort": "N m", "length": "m", "angle": "deg"}
TOLERANCE = 1e-9
"""Tolerance of the limits, for rounding."""
MAX_POINTS = 1000
"""Most points of a cut in YAML: Kinova's own server takes 2 to 1,000."""
AT_REST = 1e-3
"""Joint speed that counts as rest [rad/s]: ROS's `joint_trajectory_controller` wants exactly zero at the end."""


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of the joints.

    Attributes:
        positions: (j, 2) minimum and maximum; -inf and inf for a continuous joint [rad].
        velocities, efforts: (j,) maximum magnitudes [rad/s, N m].
    """

    positions: Floats
    velocities: Floats
    efforts: Floats


@dataclass(frozen=True, eq=False)
class CutTrajectory:
    """The motion of one cut, from rest to rest.

    Attributes:
        step: number of the cut, from 1.
        plane_W: the planned plane in W.
        p_WC: (k, 3) centroids of the fragments to cut, in W [m].
        why_moved: why a fragment was moved before the cut; None if it was not moved or the reason is unknown.
        turned_deg, carried: angle and distance by which it was moved [degrees, m].
        phases: (name, start time [s]) of every phase.
        times: (t,) time since the start of the motion, ascending [s].
        positions, velocities, efforts: (t, j) joint values [rad, rad/s, N m].
    """

    step: int
    plane_W: Plane
    p_WC: Floats
    why_moved: str | None
    turned_deg: float
    carried: float
    phases: tuple[tuple[str, float], ...]
    times: Floats
    positions: Floats
    velocities: Floats
    efforts: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "p_WC", frozen_floats(self.p_WC, (None, 3), "p_WC"))
        object.__setattr__(self, "times", frozen_floats(self.times, (None,), "times"))
        if not len(self.times) or (np.diff(self.times) <= 0).any():
            raise ValueError(f"the times of cut {self.step} are not ascending")
        joints = np.shape(self.positions)[-1]
        for name in ("positions", "velocities", "efforts"):
            values = frozen_floats(getattr(self, name), (None, joints), f"{name} of cut {self.step}")
            if len(values) != len(self.times):
                raise ValueError(f"cut {self.step} has {len(self.times)} times and {len(values)} {name}")
            object.__setattr__(self, name, values)

    @property
    def accelerations(self) -> Floats:
        """(t, j) derivatives of the velocities [rad/s2]."""
        if len(self.times) < 2:
            return np.zeros_like(self.velocities)
        return np.asarray(np.gradient(self.velocities, self.times, axis=0))


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The motions of all cuts of a trial.

    Attributes:
        trial: name of the trial in its run.
        arm: name of the arm.
        joints: names of the j joints.
        limits: limits of the joints.
        cuts: the cuts, in order.
    """

    trial: str
    arm: str
    joints: tuple[str, ...]
    limits: Limits
    cuts: tuple[CutTrajectory, ...]

    def violations(self) -> list[str]:
        """One line for every limit that a joint exceeds in a cut, with the largest excess; empty if there is none."""
        return [line for cut in self.cuts for line in self._violated(cut)]

    def _violated(self, cut: CutTrajectory) -> Iterator[str]:
        low, high = self.limits.positions.T
        for what, unit, values, lower, upper in (
            ("position", "rad", cut.positions, low, high),
            ("velocity", "rad/s", cut.velocities, -self.limits.velocities, self.limits.velocities),
            ("effort", "N m", cut.efforts, -self.limits.efforts, self.limits.efforts),
        ):
            beyond = np.maximum(lower - values, values - upper)
            for j, name in enumerate(self.joints):
                worst = int(np.argmax(beyond[:, j]))
                if beyond[worst, j] <= TOLERANCE:
                    continue
                value = values[worst, j]
                limit = lower[j] if value < lower[j] else upper[j]
                yield (
                    f"cut {cut.step}, {name}: {what} {value:.4f} {unit} at {cut.times[worst]:.3f} s is beyond its "
                    f"limit {limit:.4f} {unit}"
                )

    def thinned(self, rate: float) -> "Trajectory":
        """Thin the motions to about `rate` points per second [1/s], keeping the first and last point of every phase."""
        return replace(self, cuts=tuple(_thinned(cut, rate) for cut in self.cuts))


def trajectory_of(events: Sequence[Event], trial: str, arm: str) -> Trajectory | None:
    """The trajectory of a trial; None if no arm moved.

    A joint without end stops is counted in such turns that the first cut begins between -pi and pi, where drivers
    report it; later positions may lie beyond.

    Args:
        events: events of the trial.
        trial: name of the trial.
        arm: name of the arm.
    """
    moved = [event for event in events if isinstance(event, CutMade) and event.motion is not None]
    if not moved or moved[0].motion is None:
        return None
    first = moved[0].motion
    limits = Limits(first.position_limits, first.velocity_limits, first.torque_limits)
    whole_turns = first.positions[0] - np.array([math.remainder(q, math.tau) for q in first.positions[0]])
    offsets = np.where(np.isinf(limits.positions).all(axis=1), whole_turns, 0.0)
    planned = {event.step: event.cut for event in events if isinstance(event, Planned)}  # the last attempt of each step
    cuts = []
    for event in moved:
        motion, how = event.motion, event.execution
        assert motion is not None
        cuts.append(
            CutTrajectory(
                step=event.step,
                plane_W=planned[event.step].plane_W,
                p_WC=planned[event.step].p_WC,
                why_moved=how.why_moved if how else None,
                turned_deg=how.turned_deg if how else 0.0,
                carried=how.carried if how else 0.0,
                phases=tuple((phase.name, float(motion.times[phase.first])) for phase in motion.phases),
                times=motion.times,
                positions=motion.positions - offsets,
                velocities=motion.velocities,
                efforts=motion.torques,
            )
        )
    return Trajectory(trial, arm, first.joints, limits, tuple(cuts))


def _thinned(cut: CutTrajectory, rate: float) -> CutTrajectory:
    times = cut.times
    sample_times = np.arange(times[0], times[-1], 1.0 / rate)
    starts = np.searchsorted(times, [start for _, start in cut.phases])
    ends = np.maximum(starts - 1, 0)
    chosen = np.unique(np.concatenate([np.searchsorted(times, sample_times - 1e-9), starts, ends, [0, len(times) - 1]]))
    chosen = chosen[chosen < len(times)]
    rows = {name: getattr(cut, name)[chosen] for name in ("times", "positions", "velocities", "efforts")}
    return replace(cut, **rows)


# --- JSON -------------------------------------------------------------------------------------------------------------


def trajectory_to_json(trajectory: Trajectory) -> bytes:
    """The trajectory as JSON, a line for each point; `trajectory_from_json` is the inverse, to the last bit."""
    limits = trajectory.limits
    head = {
        "format": FORMAT,
        "schema": SCHEMA,
        "units": UNITS,
        "trial": trajectory.trial,
        "arm": trajectory.arm,
        "joints": list(trajectory.joints),
        "limits": {
            "positions": [[x if math.isfinite(x) else None for x in pair] for pair in limits.positions.tolist()],
            "velocities": limits.velocities.tolist(),
            "efforts": limits.efforts.tolist(),
        },
    }
    cuts = []
    for cut in trajectory.cuts:
        points = ",\n".join(f"    {_line(point)}" for point in _points(cut))
        facts = "".join(f"   {_line(name)}: {_line(value)},\n" for name, value in _facts(cut).items())
        cuts.append(f'  {{\n{facts}   "points": [\n{points}\n   ]\n  }}')
    lines = "".join(f" {_line(name)}: {_line(value)},\n" for name, value in head.items())
    inside = ",\n".join(cuts)
    return f'{{\n{lines} "cuts": [\n{inside}\n ]\n}}\n'.encode()


def _line(value: Any) -> str:
    return json.dumps(value, allow_nan=False, ensure_ascii=False)


def _facts(cut: CutTrajectory) -> dict[str, Any]:
    moved = {"why": cut.why_moved, "turned_deg": cut.turned_deg, "carried": cut.carried}
    return {
        "step": cut.step,
        "plane_W": cut.plane_W.to_vector().tolist(),
        "p_WC": cut.p_WC.tolist(),
        "moved": None if cut.why_moved is None else moved,
        "phases": [{"name": name, "time_from_start": start} for name, start in cut.phases],
    }


def _points(cut: CutTrajectory) -> Iterator[dict[str, Any]]:
    columns = (cut.times.tolist(), cut.positions.tolist(), cut.velocities.tolist(), cut.efforts.tolist())
    for t, q, v, e in zip(*columns, strict=True):
        yield {"time_from_start": t, "positions": q, "velocities": v, "efforts": e}


def trajectory_from_json(content: bytes | str, name: str = "the trajectory") -> Trajectory:
    """The inverse of `trajectory_to_json`.

    Args:
        content: content of the file.
        name: name of the file, for error messages.

    Raises:
        InputError: the content is not a trajectory, has another schema, or is damaged.
    """
    try:
        data = parse_json(content)
    except ValueError as error:
        raise InputError(f"{name} is not JSON: {error}; `cutgrammar export --out FILE.json` writes it") from None
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise InputError(f"{name} is not a {FORMAT}; `cutgrammar export --out FILE.json` writes one")
    if data.get("schema") != SCHEMA:
        raise InputError(
            f"{name} has schema {shortened(data.get('schema'))}, and this version of cutgrammar reads {SCHEMA}; "
            "export it again"
        )
    try:
        joints = tuple(str(joint) for joint in data["joints"])
        count = len(joints)
        bounds = [
            [-math.inf if low is None else float(low), math.inf if high is None else float(high)]
            for low, high in data["limits"]["positions"]
        ]
        limits = Limits(
            np.array(bounds).reshape(count, 2),
            frozen_floats(data["limits"]["velocities"], (count,), "velocities"),
            frozen_floats(data["limits"]["efforts"], (count,), "efforts"),
        )
        cuts = tuple(_cut_from(cut, count) for cut in data["cuts"])
        return Trajectory(str(data["trial"]), str(data["arm"]), joints, limits, cuts)
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
        problem = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise InputError(f"{name} is damaged: {problem}; export it again") from None


def _cut_from(data: dict[str, Any], joints: int) -> CutTrajectory:
    points, moved = data["points"], data["moved"]
    rows = {
        name: np.array([point[name] for point in points], dtype=np.float64).reshape(len(points), joints)
        for name in ("positions", "velocities", "efforts")
    }
    n_and_d = frozen_floats(data["plane_W"], (4,), "plane_W")
    return CutTrajectory(
        step=int(data["step"]),
        plane_W=Plane(n_and_d[:3], float(n_and_d[3])),
        p_WC=np.array(data["p_WC"], dtype=np.float64).reshape(-1, 3),
        why_moved=None if moved is None else str(moved["why"]),
        turned_deg=0.0 if moved is None else float(moved["turned_deg"]),
        carried=0.0 if moved is None else float(moved["carried"]),
        phases=tuple((str(phase["name"]), float(phase["time_from_start"])) for phase in data["phases"]),
        times=np.array([point["time_from_start"] for point in points], dtype=np.float64),
        **rows,
    )


# --- ROS --------------------------------------------------------------------------------------------------------------


def to_ros_yaml(trajectory: Trajectory) -> bytes:
    """A YAML document for each cut, with the fields of `trajectory_msgs/JointTrajectory`, as controllers accept it.

    The stamp of the header is zero, which tells a controller to start immediately; phases are written as comments.
    A `joint_trajectory_controller` with a position interface refuses efforts, so there are none, and a motion that does
    not end with velocities of zero, so rest is written as zero. A cut has at most `MAX_POINTS` points, evenly spread.
    """
    names = json.dumps(list(trajectory.joints))
    lines = [f"# {trajectory.arm}: {trajectory.trial}; one document per cut, trajectory_msgs/JointTrajectory"]
    for whole in trajectory.cuts:
        cut = _at_most(MAX_POINTS, whole)
        starts = [f"{name} {start:.3f} s" for name, start in cut.phases]
        lines += ["---", f"# cut {cut.step}: {', '.join(starts)}"]
        lines += ["header:", "  stamp: {sec: 0, nanosec: 0}", "  frame_id: ''", f"joint_names: {names}", "points:"]
        for t, *columns in zip(cut.times, cut.positions, *_from_rest_to_rest(cut), strict=True):
            sec, nanosec = divmod(round(float(t) * 1e9), 1_000_000_000)
            for i, (name, values) in enumerate(zip(("positions", "velocities", "accelerations"), columns, strict=True)):
                lines.append(f"{'- ' if i == 0 else '  '}{name}: [{', '.join(map(_yaml_float, values.tolist()))}]")
            lines.append(f"  time_from_start: {{sec: {sec}, nanosec: {nanosec}}}")
    return ("\n".join(lines) + "\n").encode()


def _at_most(n: int, cut: CutTrajectory) -> CutTrajectory:
    """The cut, thinned to at most n points, which must be more than twice its phases."""
    if len(cut.times) <= n:
        return cut
    between = n - 2 * len(cut.phases) - 3  # `_thinned` also keeps both ends of phases, and one point more at most
    return _thinned(cut, between / (cut.times[-1] - cut.times[0]))


def _from_rest_to_rest(cut: CutTrajectory) -> tuple[Floats, Floats]:
    """Velocities and accelerations (t, j), zero at both ends where the arm is at rest."""
    velocities, accelerations = cut.velocities.copy(), cut.accelerations.copy()
    for end in (0, -1):
        if np.abs(velocities[end]).max() < AT_REST:
            velocities[end] = accelerations[end] = 0.0
    return velocities, accelerations


def _yaml_float(value: float) -> str:
    """A number with a decimal point, since YAML 1.1 parsers read 1e-05 as a string."""
    text = repr(value)
    mantissa, e, exponent = text.partition("e")
    return text if "." in mantissa or not e else f"{mantissa}.0e{exponent}"
