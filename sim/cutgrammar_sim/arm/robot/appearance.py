"""Meshes of the parts of an arm and its tool, and their poses, for recordings, films and checks.

The parts of the arm look like the capsules that cover them; the gripper extends from its housing like a telescope.
"""

from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.motion import Link
from cutgrammar_sim.arm.robot.description import X_WA, Arm, Capsule
from cutgrammar_sim.arm.robot.kinematics import link_poses
from cutgrammar_sim.arm.robot.pinocchio_model import to_se3
from cutgrammar_sim.arm.robot.tool import Tool
from cutgrammar_sim.foods import tube_faces

AROUND, CAP = 16, 4
"""Vertices around a capsule, and rings of each of its caps."""
TUBES = 3
"""Number of tubes of the gripper; each slides out of the one before."""
BEVEL = 0.004
"""Height of the blade's ground edge [m]."""


@lru_cache(maxsize=8)
def links_of(arm: Arm, tool: Tool) -> tuple[Link, ...]:
    """Meshes of the arm's links, base first, then of the parts of the tool."""
    links = [Link(link.name, _joined([_capsule(c) for c in link.capsules])) for link in arm.links if link.capsules]
    blade = Link("blade", blade_of(tool))
    tool_parts = [Link("handle", _capsule(tool.handle)), blade, Link("gripper", _capsule(tool.gripper_in))]
    return (*links, *tool_parts, *(Link(f"gripper tube {i + 1}", _capsule(_tube(tool, i))) for i in range(TUBES)))


def poses_of(arm: Arm, tool: Tool, q: Floats, gripper_out: "np.ndarray[tuple[int], np.dtype[np.bool_]]") -> Floats:
    """Poses of the parts of `links_of`.

    Args:
        q: (t, n) postures [rad].
        gripper_out: (t,) whether the gripper is extended.

    Returns:
        (t, l, 7) X_WL: position [m], then quaternion w x y z.
    """
    in_A = link_poses(arm, q)
    X_AT = in_A[:, -1] @ to_se3(arm.X_LT).homogeneous
    X_AB = X_AT @ to_se3(tool.X_TB).homogeneous
    parts = [in_A[:, i] for i, link in enumerate(arm.links) if link.capsules]
    parts += [X_AT, X_AB, X_AT]
    _, slide = _telescope(tool)
    for i in range(TUBES):
        out = X_AT.copy()
        out[:, :3, 3] += (gripper_out * (i + 1))[:, None] * (X_AT[:, :3, :3] @ slide)
        parts.append(out)
    X_WL = to_se3(X_WA).homogeneous @ np.stack(parts, axis=1)
    return to_vectors(X_WL)


def to_vectors(poses: Floats) -> Floats:
    """(..., 7) position and quaternion w x y z with w >= 0, from (..., 4, 4)."""
    turns = Rotation.from_matrix(poses[..., :3, :3].reshape(-1, 3, 3)).as_quat(scalar_first=True, canonical=True)
    return np.concatenate([poses[..., :3, 3], turns.reshape(*poses.shape[:-2], 4)], axis=-1)


def blade_of(tool: Tool) -> Mesh:
    """The blade in B, with a ground edge at the bottom."""
    half, bevel = max(tool.thickness, 5e-4) / 2.0, min(BEVEL, tool.height / 2.0)
    outline = np.array([[0.0, 0.0], [half, bevel], [half, tool.height], [-half, tool.height], [-half, bevel]])
    sides = [
        np.column_stack([outline[:, 0], np.full(5, y), outline[:, 1]]) for y in (-tool.length / 2, tool.length / 2)
    ]
    fan: Ints = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4]])
    around = [(i, (i + 1) % 5) for i in range(5)]
    walls = [face for i, j in around for face in ((i, i + 5, j), (j, i + 5, j + 5))]
    return Mesh(np.concatenate(sides), np.concatenate([fan, fan[:, ::-1] + 5, np.array(walls)]))


def _telescope(tool: Tool) -> tuple[Floats, Floats]:
    """(3,) tip of the housing in T, and (3,) vector by which each tube slides out of the one before [m]."""
    inner, outer = tool.gripper_in.ends[1], tool.gripper_out.ends[1]
    return inner, (outer - inner) / TUBES


def _tube(tool: Tool, number: int) -> Capsule:
    """A tube of the retracted gripper, in T."""
    tip, slide = _telescope(tool)
    return Capsule(np.array([tip - slide, tip]), tool.gripper_in.radius * (0.9 - 0.2 * number))


def _capsule(capsule: Capsule) -> Mesh:
    """The surface of a capsule."""
    a, b = capsule.ends
    length = float(np.linalg.norm(b - a))
    z = (b - a) / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    lift = np.pi / 2.0 * np.arange(1, CAP + 1) / CAP  # from the pole to the equator of a cap
    out = capsule.radius * np.concatenate([np.sin(lift), np.sin(lift[::-1])])
    up = np.concatenate([-capsule.radius * np.cos(lift), length + capsule.radius * np.cos(lift[::-1])])
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    rings = out[:, None, None] * (np.cos(angle)[:, None] * x + np.sin(angle)[:, None] * np.cross(z, x))
    corners = (a + up[:, None, None] * z + rings).reshape(-1, 3)
    poles = np.array([a - capsule.radius * z, b + capsule.radius * z])
    return Mesh(np.concatenate([corners, poles]), tube_faces(2 * CAP, AROUND))


def _joined(meshes: list[Mesh]) -> Mesh:
    """Several surfaces as one."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))
