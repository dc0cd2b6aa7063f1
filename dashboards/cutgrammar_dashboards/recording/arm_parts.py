"""The parts of a robot as a tree: each is placed relative to the part beside which it moves least.

The pose of a link relative to the link before it changes only by its joint's angle, and a tool does not move relative
to its flange, so a recording of relative poses is several times smaller than one of poses in the world.
"""

from collections.abc import Sequence

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints

STILL = 1e-6
"""A body stands still if no number of its pose, in metres and unit quaternions, changes by more than this."""
NONE = np.empty(0)


def by_part(poses: Floats) -> Floats:
    """(l, t, 7) of (t, l, 7), so that the poses of one part lie beside each other."""
    return np.ascontiguousarray(poses.transpose(1, 0, 2))


def seen_from(poses: Floats, frames: Floats) -> Floats:
    """(t, 7) X_OB from X_WB and X_WO, (t, 7) each."""
    from cutgrammar_dashboards.recording.pose_kernels import relative  # see `moving`

    return np.asarray(relative(poses, frames))


def held(poses: Floats) -> Floats:
    """(t, 7) with each number as it was until it has changed by more than `STILL`; recordings then compress better."""
    from cutgrammar_dashboards.recording.pose_kernels import held_numbers  # see `moving`

    return np.asarray(held_numbers(np.ascontiguousarray(poses), STILL))


def part_tree(poses: Floats) -> list[int | None]:
    """The part that each part is placed relative to, None for the world; a part comes after its parent.

    Args:
        poses: (t, l, 7) X_WL of the l parts in one motion (position, quaternion w x y z).
    """
    parents: list[int | None] = []
    for i, part in enumerate(in_W := by_part(poses)):
        costs: dict[int | None, int] = {j: _changes(seen_from(part, in_W[j])) for j in range(i - 1, -1, -1)}
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
    from cutgrammar_dashboards.recording.pose_kernels import changed_rows  # numba takes a third of a second to import

    return np.asarray(changed_rows(np.ascontiguousarray(values), NONE if before is None else before, STILL))


def _changes(poses: Floats) -> int:
    """How many numbers of these poses differ from one time to the next; a recording compresses those that do not."""
    return int((np.abs(np.diff(poses, axis=0)) > STILL).sum())
