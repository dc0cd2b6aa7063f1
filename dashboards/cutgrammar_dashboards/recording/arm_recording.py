"""A robot's motion in a recording: its parts once and then where they are, the blade's path, shares of the limits."""

from collections.abc import Callable
from typing import Any

import numpy as np
import rerun as rr

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.motion import Execution, Motion
from cutgrammar_dashboards.recording import blueprint
from cutgrammar_dashboards.rendering.palette import PLANE, QUIET, Colour
from cutgrammar_dashboards.rendering.shading import split_at_creases

PICTURES = 30.0
"""Pictures a second that are kept of a motion [1/s]."""
STILL = 1e-6
"""What moved by no more than this in any number of its pose, of metres and unit quaternions, stands still."""
PART: Colour = (226, 228, 232)
EDGE: Colour = (170, 190, 214)
DARK: Colour = (92, 98, 108)
"""Colours of the arm's parts, of blades, and of what else is on its flange."""

Clock = Callable[[Floats], list[Any]]
"""The columns of times that belong to seconds (n,) after a motion began."""


class ArmRecording:
    """The arm within one recording."""

    def __init__(self, out: Any) -> None:
        self._out = out
        self._parts: set[str] = set()

    def show(self, motion: Motion, clock: Clock) -> None:
        """Record all of a motion but the fragments."""
        if not self._parts:
            blueprint.arm_styles(self._out, motion.joints)
        kept = thinned(motion.times)
        times = motion.times[kept]
        for i, link in enumerate(motion.links):
            path = f"{blueprint.ARM}/{link.name.replace(' ', '_')}"
            if path not in self._parts:
                self._parts.add(path)
                vertices, normals, faces, _ = split_at_creases(link.mesh)
                mesh = rr.Mesh3D(
                    vertex_positions=vertices,
                    vertex_normals=normals,
                    triangle_indices=faces,
                    albedo_factor=_colour(link.name),
                )
                self._out.log(path, mesh, static=True, strict=True)
            seven = motion.poses[kept, i]
            moved = moving(seven)
            self._out.send_columns(
                path,
                indexes=clock(times[moved]),
                columns=rr.Transform3D.columns(
                    translation=seven[moved, :3], quaternion=np.roll(seven[moved, 3:], -1, axis=1)
                ),
            )
        self._show_path(motion, kept)
        torque = peaks(np.abs(motion.torques) / motion.torque_limits, kept)
        velocity = peaks(np.abs(motion.velocities) / motion.velocity_limits, kept)
        for path, values in (
            (blueprint.TORQUE, torque),
            (blueprint.VELOCITY, velocity),
            (blueprint.FORCE, peaks(motion.blade_force[:, None], kept)),
        ):
            columns = rr.Scalars.columns(scalars=values.ravel()).partition([values.shape[1]] * len(values))
            self._out.send_columns(path, indexes=clock(times), columns=columns)

    def _show_path(self, motion: Motion, kept: Ints) -> None:
        """The way of the middle of the blade's edge, phase by phase."""
        starts = [phase.first for phase in motion.phases]
        strips, colours, radii = [], [], []
        for phase, first, end in zip(motion.phases, starts, [*starts[1:], len(motion.times)], strict=True):
            within = kept[(kept >= first) & (kept <= end)]  # up to where the next begins, so that no gap is seen
            if len(within) < 2 or np.ptp(motion.X_WB[within, :3], axis=0).max() <= STILL:
                continue
            pressed = phase.name == "press"
            strips.append(motion.X_WB[within, :3])
            colours.append(PLANE if pressed else QUIET)
            radii.append(rr.Radius.ui_points(2.5 if pressed else 1.0))
        self._out.log(blueprint.BLADE, rr.LineStrips3D(strips, colors=colours, radii=radii), strict=True)


def _colour(name: str) -> Colour:
    words = set(name.lower().split())
    if words & {"blade", "knife"}:
        return EDGE
    return DARK if words & {"handle", "gripper", "base"} else PART


def thinned(times: Floats, rate: float = PICTURES) -> Ints:
    """Indices of samples about `rate` times a second, the first and the last among them.

    Args:
        times: (t,) ascending [s].
        rate: [1/s].
    """
    wanted = np.arange(times[0], times[-1], 1.0 / rate)
    return np.unique([*np.searchsorted(times, wanted - 1e-9), len(times) - 1])


def moving(poses: Floats, before: Floats | None = None) -> Ints:
    """Indices of the poses that differ from the last one kept, so that nothing is lost by leaving out the others.

    Args:
        poses: (n, 7) of one body.
        before: (7,) where it was; None keeps the first pose in any case.
    """
    kept: list[int] = []
    last = before
    for i, pose in enumerate(poses):
        if last is None or np.abs(pose - last).max() > STILL:
            kept.append(i)
            last = pose
    return np.array(kept, dtype=np.int64)


def peaks(values: Floats, kept: Ints) -> Floats:
    """(k, j) the greatest of values (t, j) since the sample kept before, so that no peak falls between."""
    since = np.maximum.reduceat(values, kept[:-1] + 1, axis=0) if len(kept) > 1 else values[:0]
    return np.concatenate([values[kept[:1]], since])


def told(execution: Execution) -> str:
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
