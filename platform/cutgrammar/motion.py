"""What a robot did for one cut: its motion sample by sample, and the execution in numbers."""

from dataclasses import dataclass

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Mesh


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid part of a robot or its tool, as it looks.

    Attributes:
        name: of the part.
        mesh: its surface in the part's frame L [m].
    """

    name: str
    mesh: Mesh


@dataclass(frozen=True, eq=False)
class Phase:
    """A stretch of a motion in which the same fragments are there.

    Attributes:
        name: "transit", "pick", "carry", "place", "approach", "press", "retreat", "settle".
        first: index of its first sample in the motion's times; it lasts until the next phase begins.
        fragments: what is there, as it lies when the phase begins.
        poses: (k, f, 7) X_WF of the f fragments at the phase's k samples, or None where they all stand still.
    """

    name: str
    first: int
    fragments: Configuration
    poses: Floats | None = None


@dataclass(frozen=True, eq=False)
class Motion:
    """All that a robot did for one cut, sample by sample: to look at, to check, to hand on to a real arm.

    Attributes:
        times: (t,) since the motion began [s], ascending.
        joints: names of the j joints.
        positions, velocities: (t, j) of the joints [rad, rad/s].
        torques: (t, j) that the motors bear: drive and gravity [N m].
        position_limits, velocity_limits, torque_limits: (j, 2), (j,), (j,); positions of a joint without end are
            bounded by -inf and inf.
        wrench_W: (t, 6) force and torque of the tool on the flange, about the flange's origin, axes of W [N, N m].
        blade_force: (t,) of the food on the blade's edge and sides, against the movement [N].
        links: the l parts of the robot and its tool.
        poses: (t, l, 7) X_WL of every part (position, quaternion w x y z).
        X_WB: (t, 7) of the blade: origin in the middle of its edge, y along the edge, z from the edge to the back.
        phases: what was done when.
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
    """A robot's cut in numbers; part of the record.

    Attributes:
        why_moved: why the fragment was moved before it was cut, None where it was cut where it lay.
        turned_deg: by how much it was turned [degrees].
        carried: how far its centroid was carried [m].
        plane_error_deg, plane_error_mm: greatest angle between the plane meant and the blade's, and greatest distance
            between the two within the section, while the blade was in the fragment [degrees, mm].
        seconds: simulated time of the whole motion [s].
        blade_force: greatest force on the blade [N].
        torque_share, velocity_share: greatest share of its limit that any joint's torque and velocity reached.
        limits_kept: no joint left its range, and no velocity or torque its limit.
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
