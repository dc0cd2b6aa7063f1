"""Where an arm waits while cameras look: knife down over the board, withdrawn from what they see.

Found by inverse kinematics from the same few postures every time. Capsules count as rows of balls, which is exact
enough for a choice among postures.
"""

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.robot.description import X_WA, Arm, ArmLink, Capsule, Joint
from cutgrammar_sim.arm.robot.kinematics import flange_poses, link_poses, solutions
from cutgrammar_sim.arm.robot.tool import BACK

CAMERAS = np.array([[0.5, 0.0, 0.75], [-0.35, 0.6, 0.7]])
"""Where cameras stand in W: before the board, and beside it on the left [m]."""
BOARD = np.stack(np.meshgrid([-0.15, 0.0, 0.15], [-0.15, 0.0, 0.15], [0.0, 0.06]), axis=-1).reshape(-1, 3)
"""(k, 3) points that they are to see [m]."""
PLACES = tuple(itertools.product((0.47, 0.55), (-0.04, -0.12), (-0.1, -0.2, 0.0)))
"""z, x and y of the flange in W, in the order in which they are tried [m]."""
YAWS = (0.0, 90.0, -90.0, 180.0)
"""Of the knife about the vertical [degrees]."""
HANGING = Capsule(np.array([[0.0, 0.0, 0.02], [0.0, 0.0, 0.17]]), 0.04)
"""Knife and gripper, near enough, in T."""
CLEAR = 0.03
"""From the lines of sight, at which a posture is taken at once [m]."""
NEVER = -math.inf
"""The room of a posture that will not do."""
LEEWAY = 0.1
"""Metres that a radian to the nearest limit of a joint is worth: a posture that is at a limit is no place to start."""


def home_of(links: Sequence[ArmLink], joints: Sequence[Joint], X_LT: Pose) -> Floats | None:
    """A posture (n,) in which to wait; None if none brings the knife down over the board, free of board and arm."""
    arm = Arm("", tuple(links), tuple(joints), X_LT, np.zeros(len(joints)))
    seeds = list(_seeds(arm))
    best: tuple[float, Floats] | None = None
    for z, x, y in PLACES:
        for yaw in YAWS:
            X_WT = Pose(Rotation.from_euler("z", yaw, degrees=True).as_matrix() @ BACK, np.array([x, y, z]))
            for q in solutions(arm, X_WA.inverse() @ X_WT, seeds):
                room = _room(arm, q)
                if room >= CLEAR:
                    return q
                if room > (NEVER if best is None else best[0]):
                    best = room, q
    return None if best is None else best[1]


def _seeds(arm: Arm) -> Iterator[Floats]:
    """Twelve postures spread over all that the joints can do (a Kronecker sequence)."""
    low, high = np.array([[max(j.low, -math.pi), min(j.high, math.pi)] for j in arm.joints]).T
    ratios = np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0, 29.0])[: len(low)]
    for k in range(1, 13):
        yield low + (high - low) * np.modf(0.5 + k * ratios)[0]


def _room(arm: Arm, q: Floats) -> float:
    """How far the arm is from lines of sight and limits; less where it touches itself, `NEVER` on the board or tool."""
    poses, X_AT = link_poses(arm, q)[0], flange_poses(arm, q)[0]
    balls = [
        _balls(capsule, X, i)
        for i, (link, X) in enumerate(zip(arm.links, poses, strict=True))
        for capsule in link.capsules
    ]
    p, radius, link = (
        np.concatenate(parts) for parts in zip(*balls, _balls(HANGING, X_AT, len(arm.links)), strict=True)
    )
    lowest = (p[link > 1, 2] - radius[link > 1]).min()
    apart = np.linalg.norm(p[:, None] - p, axis=2) - radius[:, None] - radius
    far = np.abs(link[:, None] - link) > 2
    of_tool = (link == len(arm.links))[:, None]
    if lowest < 0.0 or apart[far & of_tool].min(initial=math.inf) < 0.0:
        return NEVER
    closest = apart[far].min(initial=math.inf)
    if closest < 0.0:  # shapes that are only guessed may touch in every posture
        return float(closest) - 1.0
    ends = np.repeat(CAMERAS, len(BOARD), axis=0)
    starts = np.tile(BOARD, (len(CAMERAS), 1))
    along = ends - starts
    share = np.einsum("kma,ma->km", p[:, None] - starts, along) / (along**2).sum(axis=1)
    nearest = starts + np.clip(share, 0.0, 1.0)[..., None] * along
    leeway = min(min(a - joint.low, joint.high - a) for a, joint in zip(q, arm.joints, strict=True))
    sight = float((np.linalg.norm(p[:, None] - nearest, axis=2) - radius[:, None]).min())
    return min(sight, LEEWAY * float(leeway))


def _balls(capsule: Capsule, X_AL: Floats, link: int) -> tuple[Floats, Floats, Floats]:
    """Middles in W, radii and the link's number of the balls that stand for a capsule."""
    count = 2 + int(np.linalg.norm(capsule.ends[1] - capsule.ends[0]) / capsule.radius)
    middles = capsule.ends[0] + np.linspace(0.0, 1.0, count)[:, None] * (capsule.ends[1] - capsule.ends[0])
    in_world = X_WA.apply(middles @ X_AL[:3, :3].T + X_AL[:3, 3])
    return in_world, np.full(count, capsule.radius), np.full(count, float(link))
