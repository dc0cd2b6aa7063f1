"""The configurations of a trial as bytes: compact, exact enough for pictures, without pickle.

Vertices have single precision, poses double. One trial of a run shares its start with all others of its demonstration,
and its goal with those of all methods, so the ledger keeps each content once, under its digest.
"""

import io
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.untrusted.archives import read_arrays

ROLES = ("start", "goal", "reached")
MAX_BYTES = 500_000_000
"""Most bytes of a configuration, unpacked."""
MAX_FRAGMENTS = 10_000
MAX_DISTANCE = 100.0
"""Largest magnitude of a coordinate [m]."""


@dataclass(frozen=True, eq=False)
class TrialConfigurations:
    """Where a trial started, its goal as it was laid out for the trial, and what was reached."""

    start: Configuration
    goal: Configuration
    reached: Configuration


Contents = Mapping[str, bytes]
"""Role -> content of its configuration, of all roles or of none."""


def contents_of(configurations: TrialConfigurations) -> Contents:
    """The configurations as they are stored; none where a shape is not a mesh."""
    encoded = {role: encode(getattr(configurations, role)) for role in ROLES}
    known = {role: content for role, content in encoded.items() if content is not None}
    return known if len(known) == len(ROLES) else {}


def encode(configuration: Configuration) -> bytes | None:
    """A configuration as a compressed archive of arrays; None where a shape is not a mesh."""
    if not configuration or not all(isinstance(fragment.shape, Mesh) for fragment in configuration):
        return None
    meshes = [fragment.mesh for fragment in configuration]
    arrays = {
        "vertices": np.concatenate([mesh.vertices for mesh in meshes]).astype(np.float32),
        "faces": np.concatenate([mesh.faces for mesh in meshes]).astype(np.uint32),
        "counts": np.array([(len(mesh.vertices), len(mesh.faces)) for mesh in meshes], dtype=np.uint32),
        "rotations": np.array([fragment.X_WF.rotation for fragment in configuration]),
        "positions": np.array([fragment.X_WF.position for fragment in configuration]),
    }
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def decode(content: bytes) -> Configuration:
    """The inverse of `encode`.

    Raises:
        ValueError: not such content.
    """
    try:
        arrays = read_arrays(content, MAX_BYTES)
    except ValueError as error:
        raise ValueError(f"not a configuration: {error}") from error
    if missing := [name for name in ("vertices", "faces", "counts", "rotations", "positions") if name not in arrays]:
        raise ValueError(f"not a configuration: it has no {missing[0]}")
    vertices, faces = arrays["vertices"].astype(np.float64), arrays["faces"].astype(np.int64)
    counts, rotations, positions = arrays["counts"].astype(np.int64), arrays["rotations"], arrays["positions"]
    n = len(counts) if counts.ndim == 2 else 0
    if not 1 <= n <= MAX_FRAGMENTS or (counts.shape, rotations.shape, positions.shape) != ((n, 2), (n, 3, 3), (n, 3)):
        raise ValueError("not a configuration: counts, rotations and positions do not fit together")
    if counts.min() < 1 or tuple(counts.sum(axis=0)) != (len(vertices), len(faces)):
        raise ValueError("not a configuration: the counts are not those of its vertices and faces")
    if not max(np.abs(vertices).max(), np.abs(positions).max()) <= MAX_DISTANCE:
        raise ValueError(f"not a configuration: coordinates are not finite, or beyond {MAX_DISTANCE:g} m")
    ends = np.cumsum(counts, axis=0)[:-1].T
    parts = zip(np.split(vertices, ends[0]), np.split(faces, ends[1]), rotations, positions, strict=True)
    return tuple(Fragment(Mesh(v, f), Pose(rotation, position)) for v, f, rotation, position in parts)
