"""The configurations of a trial as bytes: compact, exact enough for pictures, without pickle.

Vertices have single precision, poses double. One trial of a run shares its start with all others of its demonstration,
and its goal with those of all methods, so the ledger keeps each content once, under its digest.
"""

import io
import zipfile
from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.pose import Pose

ROLES = ("start", "goal", "reached")


@dataclass(frozen=True, eq=False)
class TrialConfigurations:
    """Where a trial started, its goal as it was laid out for the trial, and what was reached."""

    start: Configuration
    goal: Configuration
    reached: Configuration


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
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            vertices, faces = arrays["vertices"].astype(np.float64), arrays["faces"].astype(np.int64)
            ends = np.cumsum(arrays["counts"], axis=0)[:-1].T
            parts = zip(
                np.split(vertices, ends[0]),
                np.split(faces, ends[1]),
                arrays["rotations"],
                arrays["positions"],
                strict=True,
            )
            return tuple(Fragment(Mesh(v, f), Pose(rotation, position)) for v, f, rotation, position in parts)
    except (KeyError, ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"not a configuration ({error})") from error
