"""From the bodies in users' files to configurations in one world frame, and back to the frames of the files.

The world W has metres, z up, and its origin below the middle of the current fragments. All files keep their common
coordinates; only a goal that lies elsewhere is moved there as a whole.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.mesh_io.files import Scan
from cutgrammar.geometry.mesh_io.sizes import checked_scale, long_side
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose

Up = Literal["x", "y", "z"]
"""The axis of a file that points up."""
TO_Z_UP = {
    "x": np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "z": np.eye(3),
}
SIMILAR, POSSIBLE = 1.25, 10.0
"""Ratios of the goal's volume to the current one up to which nothing is said, and up to which one can be meant."""


@dataclass(frozen=True, eq=False)
class FileFrame:
    """The frame S of a file: a point of its numbers v is at X_WS (scale v) in the world.

    Attributes:
        scale: metres for one of the file's numbers.
        X_WS: pose of the file's axes in W.
    """

    scale: float
    X_WS: Pose

    def plane(self, plane_W: Plane) -> Plane:
        """A plane of W in the file's axes; its offset is in the file's numbers."""
        plane_S = plane_W.transformed(self.X_WS.inverse())
        return Plane(plane_S.normal, plane_S.offset / self.scale)

    def point(self, p_W: Floats) -> Floats:
        """A point (3,) of W in the file's numbers."""
        return np.asarray(self.X_WS.inverse().apply(p_W) / self.scale)


@dataclass(frozen=True, eq=False)
class Source:
    """Where a current fragment came from.

    Attributes:
        path: the file.
        body: number of the body in it, from 0.
        frame: the file's frame.
    """

    path: Path
    body: int
    frame: FileFrame


@dataclass(frozen=True, eq=False)
class Placed:
    """Scans in one world frame.

    Attributes:
        now: the current fragments.
        goal: the goal's.
        sources: where each fragment of `now` came from.
        goal_frames: the frame of every goal file.
        notes: what users should know.
    """

    now: Configuration
    goal: Configuration
    sources: tuple[Source, ...]
    goal_frames: tuple[FileFrame, ...]
    notes: tuple[str, ...]


def place(
    now: Sequence[Scan],
    goal: Sequence[Scan],
    unit: str | None = None,
    length: float | None = None,
    up: Up | None = None,
) -> Placed:
    """Put the bodies of files into the world frame.

    Args:
        now: files of the current fragments.
        goal: files of the desired ones.
        unit: of the numbers in all files; None: metres.
        length: real length of the longest current fragment [m], instead of a unit.
        up: the axis that points up in all files; None: y in GLB files, as their standard says, z in others.

    Raises:
        InputError: the sizes cannot be those of foods, or the goal's do not go with the current ones.
    """
    scale = _scale(now, unit, length)
    _scale(goal, unit, None if length is None else scale * _longest(goal)[1])
    turns = [TO_Z_UP[up or ("y" if scan.path.suffix.lower() == ".glb" else "z")] for scan in (*now, *goal)]
    turned = [
        [Mesh(scale * body.vertices @ turn.T, body.faces) for body in scan.bodies]
        for scan, turn in zip((*now, *goal), turns, strict=True)
    ]
    ours, theirs = turned[: len(now)], turned[len(now) :]
    box, goal_box = _box(ours), _box(theirs)
    notes = _compared(ours, theirs)
    shift = -np.array([*box.mean(axis=0)[:2], box[0, 2]])
    goal_shift = shift
    if (goal_box[0] > box[1]).any() or (goal_box[1] < box[0]).any():
        goal_shift = -np.array([*goal_box.mean(axis=0)[:2], goal_box[0, 2]])
        notes.append("the goal lies elsewhere than the current fragments and was moved to them as a whole")
    frames = [FileFrame(scale, Pose(turn, shift)) for turn in turns[: len(now)]]
    return Placed(
        tuple(_fragment(body, shift) for bodies in ours for body in bodies),
        tuple(_fragment(body, goal_shift) for bodies in theirs for body in bodies),
        tuple(
            Source(scan.path, i, frame)
            for scan, frame in zip(now, frames, strict=True)
            for i in range(len(scan.bodies))
        ),
        tuple(FileFrame(scale, Pose(turn, goal_shift)) for turn in turns[len(now) :]),
        tuple(notes),
    )


def _longest(scans: Sequence[Scan]) -> tuple[Path, float]:
    """The file with the longest body, and its long side."""
    return max(
        ((scan.path, long_side(body.vertices)) for scan in scans for body in scan.bodies), key=lambda found: found[1]
    )


def _scale(scans: Sequence[Scan], unit: str | None, length: float | None) -> float:
    path, longest = _longest(scans)
    extents = [float(np.ptp(body.vertices, axis=0).max()) for scan in scans for body in scan.bodies]
    try:
        return checked_scale(extents, unit, length, longest)
    except InputError as error:
        raise InputError(f"mesh {path} {error}") from None


def _box(files: Sequence[Sequence[Mesh]]) -> Floats:
    """(2, 3) lower and upper corner of the bounding box."""
    vertices = np.concatenate([body.vertices for bodies in files for body in bodies])
    return np.array([vertices.min(axis=0), vertices.max(axis=0)])


def _compared(now: Sequence[Sequence[Mesh]], goal: Sequence[Sequence[Mesh]]) -> list[str]:
    """A note if the volumes differ.

    Raises:
        InputError: they differ so much that the units must.
    """
    ratio = sum(b.volume for bodies in goal for b in bodies) / sum(b.volume for bodies in now for b in bodies)
    if not 1.0 / POSSIBLE <= ratio <= POSSIBLE:
        raise InputError(
            f"the goal's fragments have {ratio:.3g} times the volume of the current ones; cutting changes no volume; "
            "give all files in one unit, and all fragments that the current ones are to be cut into"
        )
    if 1.0 / SIMILAR <= ratio <= SIMILAR:
        return []
    return [f"the goal's fragments have {ratio:.2g} times the volume of the current ones, which cutting cannot change"]


def _fragment(body: Mesh, shift: Floats) -> Fragment:
    """A fragment whose frame has the axes of W and its origin at the centroid."""
    return Fragment(Mesh(body.vertices - body.centroid, body.faces), Pose(np.eye(3), body.centroid + shift))
