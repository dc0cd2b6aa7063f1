"""A robot's motion in a recording: its parts, the path of the blade, and joint loads as shares of their limits."""

from functools import lru_cache
from typing import Any

import numpy as np
import rerun as rr

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.motion import Execution, Motion
from cutgrammar_dashboards.recording import blueprint
from cutgrammar_dashboards.recording.arm_parts import STILL, by_part, held, moving, part_paths, part_tree, seen_from
from cutgrammar_dashboards.recording.gathered import Gathered
from cutgrammar_dashboards.recording.scene import scalars, smooth_mesh, transforms
from cutgrammar_dashboards.recording.writer import Moments, Writer
from cutgrammar_dashboards.rendering.palette import PLANE, QUIET, Colour

RATE = 8.0
"""Poses that are kept of each second of a motion [1/s]."""
LOAD_RATE = 4.0
"""Loads that are kept of each second of a motion, each the greatest since the one before [1/s]."""
PART: Colour = (226, 228, 232)
BLADE: Colour = (170, 190, 214)
DARK: Colour = (92, 98, 108)
"""Colours of the arm's parts, of blades, and of everything else on its flange."""


class ArmViews:
    """The views of the arm in one recording; `flush()` writes what `show()` has gathered, in as few chunks as possible.

    Args:
        writer: of the recording.
        motion: the first of the trial, which decides how the parts are placed relative to each other.
    """

    def __init__(self, writer: Writer, motion: Motion) -> None:
        self._writer = writer
        blueprint.arm_styles(writer, motion.joints)
        self._parents = part_tree(motion.poses[thinned(motion.times)])
        names = [link.name for link in motion.links]
        self._paths = [f"{blueprint.ARM}/{path}" for path in part_paths(names, self._parents)]
        for path, link in zip(self._paths, motion.links, strict=True):
            writer.log(path, _part(link.mesh, _part_colour(link.name)), static=True)
        self._last: dict[str, Floats] = {}
        self._gathered = Gathered(writer)

    def show(self, motion: Motion, began: float) -> None:
        """Show all of a motion except the fragments; it begins at `began` of `time` [s]."""
        kept = thinned(motion.times)
        moments = self._writer.moments(began + motion.times[kept])
        in_W = by_part(motion.poses[kept])
        for path, poses, parent in zip(self._paths, in_W, self._parents, strict=True):
            vectors = held(poses if parent is None else seen_from(poses, in_W[parent]))
            changed = moving(vectors, self._last.get(path))
            if len(changed):
                self._last[path] = vectors[changed[-1]]
                self._gathered.add(path, Moments(*(column[changed] for column in moments)), vectors[changed])
        self._show_blade_path(motion, kept)
        rare = thinned(motion.times, LOAD_RATE)
        moments = self._writer.moments(began + motion.times[rare])
        self._gathered.add(blueprint.TORQUE, moments, peaks(np.abs(motion.torques) / motion.torque_limits, rare))
        self._gathered.add(blueprint.VELOCITY, moments, peaks(np.abs(motion.velocities) / motion.velocity_limits, rare))
        self._gathered.add(blueprint.FORCE, moments, peaks(motion.blade_force[:, None], rare))

    def flush(self) -> None:
        """Write what has been gathered."""
        for path in self._gathered.paths:
            self._gathered.write(path, transforms if path in self._paths else scalars)

    def _show_blade_path(self, motion: Motion, kept: Ints) -> None:
        """The path of the middle of the blade's edge, a line for each phase."""
        starts = [phase.first for phase in motion.phases]
        strips, colours, radii = [], [], []
        for phase, first, end in zip(motion.phases, starts, [*starts[1:], len(motion.times)], strict=True):
            inside = kept[(kept >= first) & (kept <= end)]  # includes the start of the next, so that there is no gap
            if len(inside) < 2 or np.ptp(motion.X_WB[inside, :3], axis=0).max() <= STILL:
                continue
            pressed = phase.name == "press"
            strips.append(motion.X_WB[inside, :3])
            colours.append(PLANE if pressed else QUIET)
            radii.append(rr.Radius.ui_points(2.5 if pressed else 1.0))
        self._writer.log(blueprint.BLADE, rr.LineStrips3D(strips, colors=colours, radii=radii))


@lru_cache(maxsize=64)
def _part(mesh: Mesh, colour: Colour) -> Any:
    """A part of an arm; all trials of a worker have the same."""
    return smooth_mesh(mesh, colour)


def _part_colour(name: str) -> Colour:
    words = set(name.lower().split())
    if words & {"blade", "knife"}:
        return BLADE
    return DARK if words & {"handle", "gripper", "base"} else PART


def thinned(times: Floats, rate: float = RATE) -> Ints:
    """Indices of samples about `rate` times a second, including the first and the last.

    Args:
        times: (t,) ascending [s].
        rate: [1/s].
    """
    wanted = np.arange(times[0], times[-1], 1.0 / rate)
    return np.unique([*np.searchsorted(times, wanted - 1e-9), len(times) - 1])


def peaks(values: Floats, kept: Ints) -> Floats:
    """(k, j) maximum of values (t, j) since the previous kept sample, so that no peak between samples is lost."""
    since = np.maximum.reduceat(values, kept[:-1] + 1, axis=0) if len(kept) > 1 else values[:0]
    return np.concatenate([values[kept[:1]], since])


def summary(execution: Execution) -> str:
    """A robot's cut in one line."""
    moved = "cut where it lay"
    if execution.why_moved is not None:
        turned = f"turned {execution.turned_deg:.0f} degrees, " if execution.turned_deg >= 0.5 else ""
        moved = f"moved first ({execution.why_moved}): {turned}carried {100 * execution.carried:.1f} cm"
    if execution.set_aside:
        others = "1 fragment" if execution.set_aside == 1 else f"{execution.set_aside} fragments"
        moved += f", after {others} on it had been set aside"
    kept = "all limits kept" if execution.limits_kept else "A LIMIT WAS EXCEEDED"
    torque, velocity = 100 * execution.torque_share, 100 * execution.velocity_share
    return (
        f"{moved}; plane off by {execution.plane_error_deg:.3f} degrees and {execution.plane_error_mm:.3f} mm; "
        f"{execution.seconds:.1f} s; {execution.blade_force:.0f} N on the blade; torque {torque:.0f} %, velocity "
        f"{velocity:.0f} % of their limits; {kept}"
    )
