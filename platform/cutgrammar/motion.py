"""The motion of a robot during one cut, sample by sample, and a summary of its execution."""

from dataclasses import dataclass

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Mesh


@dataclass(frozen=True, eq=False)
class Link:
    """The visual mesh of a rigid part of a robot or its tool.

    Attributes:
        name: name of the part.
        mesh: its surface in the part's frame L [m].
    """

    name: str
    mesh: Mesh


@dataclass(frozen=True, eq=False)
class Phase:
    """An interval of a motion during which the same fragments exist.

    Attributes:
        name: "transit", "pick", "carry", "place", "approach", "press", "retreat", "settle".
        first: index of its first sample in the motion's times; it lasts until the next phase begins.
        fragments: the fragments at their poses at the start of the phase.
        poses: (k, f, 7) X_WF of the f fragments at the k samples of the phase; None if they do not move.
    """

    name: str
    first: int
    fragments: Configuration
    poses: Floats | None = None


@dataclass(frozen=True, eq=False)
class Motion:
    """The complete motion of a robot for one cut, sample by sample, for display, checks and export to a real arm.

    Attributes:
        times: (t,) time since the start of the motion [s], ascending.
        joints: names of the j joints.
        positions, velocities: (t, j) joint positions and velocities [rad, rad/s].
        torques: (t, j) torques of the motors, including gravity [N m].
        position_limits, velocity_limits, torque_limits: (j, 2), (j,), (j,); the position limits of a continuous joint
            are -inf and inf.
        wrench_W: (t, 6) force and torque of the tool on the flange, about its origin, in the axes of W [N, N m].
        blade_force: (t,) force of the food on the blade's edge and sides, against the motion [N].
        links: the l parts of the robot and its tool.
        poses: (t, l, 7) X_WL of every part (position, quaternion w x y z).
        X_WB: (t, 7) pose X_WB of the blade: origin mid-edge, y along the edge, z from the edge to the spine.
        phases: the phases of the motion, in order.
    """

    times: Floats
    joints: tuple[str, ...]
    positions: Floats
    velocities: Floats
    torques: Floats
    position_limits: Floats
    velocity_limits: Floats
    torque_limits: Floats
    wrench_W: Floats
    blade_force: Floats
    links: tuple[Link, ...]
    poses: Floats
    X_WB: Floats
    phases: tuple[Phase, ...]


@dataclass(frozen=True)
class Execution:
    """A summary of a robot's cut; part of the record.

    Attributes:
        why_moved: why the fragment was moved before the cut; None if it was not moved.
        turned_deg: angle by which it was turned [degrees].
        carried: distance by which its centroid was moved [m].
        plane_error_deg, plane_error_mm: maximum angle between the intended plane and the blade, and maximum distance
            between them within the section, while the blade was in the fragment [degrees, mm].
        seconds: simulated time of the whole motion [s].
        blade_force: maximum force on the blade [N].
        torque_share, velocity_share: maximum ratio of a joint's torque and velocity to its limit.
        limits_kept: whether all joint positions, velocities and torques stayed within their limits.
        set_aside: number of fragments that lay on the one to cut and were set aside first.
    """

    why_moved: str | None
    turned_deg: float
    carried: float
    plane_error_deg: float
    plane_error_mm: float
    seconds: float
    blade_force: float
    torque_share: float
    velocity_share: float
    limits_kept: bool
    set_aside: int = 0
