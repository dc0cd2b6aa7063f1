"""How the arm makes one cut, decided before anything moves.

Frames: W the world, F a fragment, B the blade, G the gripper come out (see `tool`).
"""

from dataclasses import dataclass

from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.kinova.timing import Trajectory


@dataclass(frozen=True, eq=False)
class Leg:
    """One movement of the arm, from rest to rest, in which the same things are fixed to it.

    Attributes:
        phase: "transit", "pick", "carry", "place", "approach", "press" or "retreat".
        trajectory: of the joints.
        gripper_out: whether the gripper is come out.
        holds: whether it holds the fragment that the plan carries.
    """

    phase: str
    trajectory: Trajectory
    gripper_out: bool = False
    holds: bool = False


@dataclass(frozen=True, eq=False)
class Carry:
    """A fragment is picked up, turned where needed, and set down in another place, where it is held until it is cut.

    Attributes:
        fragment: its index in the configuration.
        X_GF: how the gripper holds it.
        X_WF: how it stands once it is set down.
        why: the reason, in words.
        turned_deg: angle between its pose before and after, but for a turn about the vertical [degrees].
        distance: that its centroid is carried [m].
    """

    fragment: int
    X_GF: Pose
    X_WF: Pose
    why: str
    turned_deg: float
    distance: float


@dataclass(frozen=True, eq=False)
class CutPlan:
    """All movements of a cut, in their order; the first begins where the arm is, the last ends at home.

    With a carry they are: transit, pick | carry, place (the fragment is held) | retreat, transit, approach, press,
    retreat, transit; without, the last five. The gripper closes at the end of "pick" and opens at the end of "place".

    Attributes:
        legs: the movements; each begins in the posture in which the one before it ends.
        meant: indices of the fragments that are cut, ascending.
        plane_W: cutting plane in W when the blade is pressed: the plane asked for, moved with the fragment carried.
        X_WB: the blade when its edge has reached the board; along x of B is plus or minus the plane's normal.
        carry: how the fragment is moved before that, None where it is cut where it lies.
    """

    legs: tuple[Leg, ...]
    meant: tuple[int, ...]
    plane_W: Plane
    X_WB: Pose
    carry: Carry | None
