"""The parts of a robot as a tree: each is placed relative to the part beside which it moves least.

The pose of a link relative to the link before it changes only by its joint's angle, and a tool does not move relative
to its flange, so a recording of relative poses is several times smaller than one of poses in the world.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.arrays import Floats, Ints

STILL = 1e-6
"""A body stands still if no number of its pose, in metres and unit quaternions, changes by more than this."""


class Poses(NamedTuple):
    """Poses of one body over time, in another body's frame or in the world's.

    Attributes:
        position: (t, 3) [m].
        quaternion: (t, 4) w x y z.
    """

    position: Floats
    quaternion: Floats

    @staticmethod
    def of(vectors: Floats) -> "Poses":
        """From vectors (t, 7)."""
        return Poses(vectors[:, :3], vectors[:, 3:])

    def seen_from(self, other: "Poses") -> "Poses":
        """X_OB from X_WB and X_WO."""
        back = Rotation.from_quat(other.quaternion, scalar_first=True).inv()
        turn = back * Rotation.from_quat(self.quaternion, scalar_first=True)
        return Poses(back.apply(self.position - other.position), turn.as_quat(scalar_first=True, canonical=True))


def part_tree(poses: Floats) -> list[int | None]:
    """The part that each part is placed relative to, None for the world; a part comes after its parent.

    Args:
        poses: (t, l, 7) X_WL of the l parts in one motion (position, quaternion w x y z).
    """
    all_poses = [Poses.of(poses[:, i]) for i in range(poses.shape[1])]
    parents: list[int | None] = []
    for i, part in enumerate(all_poses):
        costs: dict[int | None, int] = {j: _changes(part.seen_from(all_poses[j])) for j in range(i - 1, -1, -1)}
        costs[None] = _changes(part)
        parents.append(min(costs, key=lambda j: costs[j]))
    return parents


def part_paths(names: Sequence[str], parents: Sequence[int | None]) -> list[str]:
    """The path of each part, below that of its parent."""
    paths: list[str] = []
    for name, parent in zip(names, parents, strict=True):
        own = name.replace(" ", "_")
        paths.append(own if parent is None else f"{paths[parent]}/{own}")
    return paths


def moving(values: Floats, before: Floats | None = None) -> Ints:
    """Indices of the rows that differ from the last one kept; the others can be left out without loss.

    Args:
        values: (t, n) of one body, such as its poses.
        before: (n,) those before them; if None, the first row is always kept.
    """
    kept: list[int] = []
    last = before
    for i, row in enumerate(values):
        if last is None or np.abs(row - last).max() > STILL:
            kept.append(i)
            last = row
    return np.array(kept, dtype=np.int64)


def _changes(poses: Poses) -> int:
    """How many numbers of these poses differ from one time to the next; a recording compresses those that do not."""
    return int((np.abs(np.diff(np.hstack(poses), axis=0)) > STILL).sum())
