"""A robot's motion in a recording: its parts, the path of the blade, and joint loads as shares of their limits."""

import numpy as np
import rerun as rr

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.motion import Execution, Motion
from cutgrammar_dashboards.recording import blueprint
from cutgrammar_dashboards.recording.scene import smooth_mesh
from cutgrammar_dashboards.recording.writer import Writer
from cutgrammar_dashboards.rendering.palette import PLANE, QUIET, Colour

RATE = 30.0
"""Samples that are kept of each second of a motion [1/s]."""
STILL = 1e-6
"""A body stands still if no number of its pose, in metres and unit quaternions, changes by more than this."""
PART: Colour = (226, 228, 232)
BLADE: Colour = (170, 190, 214)
DARK: Colour = (92, 98, 108)
"""Colours of the arm's parts, of blades, and of everything else on its flange."""


class ArmViews:
    """The views of the arm in one recording."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._logged_parts: set[str] = set()

    def show(self, motion: Motion, began: float) -> None:
        """Show all of a motion except the fragments; it begins at `began` of `time` [s]."""
        if not self._logged_parts:
            blueprint.arm_styles(self._writer.stream, motion.joints)
        kept = thinned(motion.times)
        times = motion.times[kept]
        for i, link in enumerate(motion.links):
            path = f"{blueprint.ARM}/{link.name.replace(' ', '_')}"
            if path not in self._logged_parts:
                self._logged_parts.add(path)
                self._writer.log(path, smooth_mesh(link.mesh, _part_colour(link.name)), static=True)
            vectors = motion.poses[kept, i]
            moved = moving(vectors)
            columns = rr.Transform3D.columns(
                translation=vectors[moved, :3], quaternion=np.roll(vectors[moved, 3:], -1, axis=1)
            )
            self._writer.send(path, self._writer.clock(began + times[moved]), columns)
        self._show_blade_path(motion, kept)
        torque = peaks(np.abs(motion.torques) / motion.torque_limits, kept)
        velocity = peaks(np.abs(motion.velocities) / motion.velocity_limits, kept)
        for path, values in (
            (blueprint.TORQUE, torque),
            (blueprint.VELOCITY, velocity),
            (blueprint.FORCE, peaks(motion.blade_force[:, None], kept)),
        ):
            columns = rr.Scalars.columns(scalars=values.ravel()).partition([values.shape[1]] * len(values))
            self._writer.send(path, self._writer.clock(began + times), columns)

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


def moving(poses: Floats, before: Floats | None = None) -> Ints:
    """Indices of the poses that differ from the last one kept; the others can be left out without loss.

    Args:
        poses: (n, 7) of one body.
        before: (7,) its pose before them; if None, the first pose is always kept.
    """
    kept: list[int] = []
    last = before
    for i, pose in enumerate(poses):
        if last is None or np.abs(pose - last).max() > STILL:
            kept.append(i)
            last = pose
    return np.array(kept, dtype=np.int64)


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
    kept = "all limits kept" if execution.limits_kept else "A LIMIT WAS EXCEEDED"
    torque, velocity = 100 * execution.torque_share, 100 * execution.velocity_share
    return (
        f"{moved}; plane off by {execution.plane_error_deg:.3f} degrees and {execution.plane_error_mm:.3f} mm; "
        f"{execution.seconds:.1f} s; {execution.blade_force:.0f} N on the blade; torque {torque:.0f} %, velocity "
        f"{velocity:.0f} % of their limits; {kept}"
    )
