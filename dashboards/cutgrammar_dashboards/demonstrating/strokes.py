"""From two clicks to a cut: the plane through the eye and both clicks, and the fragment that the stroke passes over."""

import numpy as np

from cutgrammar.demonstration import HandStroke
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.rays import RayCaster
from cutgrammar.geometry.slicing import Missed
from cutgrammar_dashboards.demonstrating.cutting_state import CuttingState

MIN_SINE = 1e-3
"""Minimum sine of the angle between the directions of both clicks; closer clicks define no plane."""
RAYS = 65
"""Rays, evenly spread between both clicks, that find which fragment the stroke passes over."""


def plane_of(stroke: HandStroke) -> Plane | Missed:
    """The plane in W through the eye and both clicks, or why there is none."""
    normal = np.cross(stroke.first_W, stroke.second_W)
    if np.linalg.norm(normal) < MIN_SINE:
        return Missed("both clicks are at the same place; click at two sides of what you want to cut")
    return Plane.through(stroke.p_WE, normal)


def target_of(state: CuttingState, stroke: HandStroke) -> tuple[int, Plane] | Missed:
    """The fragment that a stroke cuts, and the plane for it in W, where the fragment lies; or why there is none.

    The fragment is the one that most of the stroke passes over, as seen: the one that most rays between both clicks
    meet first, in a tie the nearest. If fragments are shown apart, the plane is moved back by the fragment's shift.
    """
    seen = plane_of(stroke)
    if isinstance(seen, Missed):
        return seen
    shifts = {i: stroke.explode * shift for i, shift in state.shifts().items()}
    shown = [Fragment(state.fragment(i).mesh, _moved(state.fragment(i).X_WF, shifts[i])) for i in state.alive]
    triangles = [fragment.X_WF.apply(fragment.mesh.triangles.reshape(-1, 3)).reshape(-1, 3, 3) for fragment in shown]
    owner = np.repeat(np.arange(len(shown)), [len(own) for own in triangles])
    shares = np.linspace(0.0, 1.0, RAYS)[:, None]
    hits = RayCaster(np.concatenate(triangles)).first_hits(
        stroke.p_WE, (1.0 - shares) * stroke.first_W + shares * stroke.second_W
    )
    met = hits.triangle >= 0
    if not met.any():
        return Missed("the stroke misses every fragment; click at two sides of one")
    owners, distances = owner[hits.triangle[met]], hits.distance[met]
    best = min(set(owners.tolist()), key=lambda k: (-int((owners == k).sum()), float(distances[owners == k].min())))
    fragment = state.alive[best]
    plane_W = Plane(seen.normal, seen.offset + float(seen.normal @ shifts[fragment]))
    return fragment, plane_W


def _moved(pose: Pose, shift: np.ndarray) -> Pose:
    return Pose(pose.rotation, pose.position + shift)
