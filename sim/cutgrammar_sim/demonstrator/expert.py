"""The methods `expert` and `expert-rough`: the demonstrator repeats a demonstration with new errors.

Every cut is the demonstration's next cut as it was intended (see `intents`), transferred to the current fragment with a
new error: 10 % of the spacing and 2 degrees as in the demonstrations, or 30 % and 6 degrees. If the intent is not
known, the demonstrated plane is used, and its distance from the nearer end of the fragment replaces the spacing. As in
the demonstrations, an error is drawn again if the plane misses the fragment or meets a face left by an earlier cut
across the same axis.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from cutgrammar.demonstration import Demonstration
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.facets import facets_of
from cutgrammar.geometry.fragment import Configuration, Mesh, vertices_of
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Missed, slice_mesh
from cutgrammar.interfaces import Cut, Refusal, Stuck
from cutgrammar.methods.alignment import aligned_frame
from cutgrammar.methods.locating import Locator, NextCut
from cutgrammar.methods.method import Method
from cutgrammar.settings import DemonstratorSettings
from cutgrammar_sim.demonstrator.intents import Intent, intents_of, plane_in_frame
from cutgrammar_sim.demonstrator.scripted_cuts import ERROR_DRAWS, MIN_SHARE, error, meets, planned_plane

CAREFUL = DemonstratorSettings(offset_error=0.10, tilt_error_deg=2.0)
ROUGH = DemonstratorSettings(offset_error=0.30, tilt_error_deg=6.0)
PLACE_WEIGHT = 0.5
"""Weight of a fragment's distance from the demonstrated place (see `Locator`)."""
WALL_DEG, WALL_SHARE = 20.0, 0.02
"""A flat face counts as left by a cut across an axis if its normal is within this angle of the axis [degrees] and its
area is at least this share of the surface."""


class ExpertPlanner:
    """Repeats the intended cuts of a demonstration with new errors.

    Args:
        demonstration: the demonstration to repeat.
        errors: size of the errors.
    """

    def __init__(self, demonstration: Demonstration, errors: DemonstratorSettings) -> None:
        self._demonstration = demonstration
        self._errors = errors
        self._locator = Locator(demonstration, PLACE_WEIGHT)

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """The demonstration's next cut with a new error, also after a refusal; `goal` is ignored."""
        del goal, refused
        following = self._locator.next_cut(now)
        if isinstance(following, Stuck):
            return following
        fragment = following.fragment
        X_NF = aligned_frame(fragment.shape, following.model)
        plane_F = self._draw_plane(following, X_NF, rng)
        if plane_F is None:
            return Stuck(f"none of {ERROR_DRAWS} planes drawn divides the fragment clear of its other cuts")
        return Cut.of_fragment(fragment, plane_F, X_NF)

    def _draw_plane(self, following: NextCut, X_NF: Pose, rng: np.random.Generator) -> Plane | None:
        """A plane for the next cut in frame F, whose pose in the fragment's frame is X_NF; None if no draw is valid."""
        shape = following.fragment.shape
        corners = X_NF.inverse().apply(vertices_of(shape))
        box = corners.min(axis=0), corners.max(axis=0)
        intent = self._intents[following.cut.step]
        demonstrated = plane_in_frame(following.cut, following.model)
        mesh = shape.moved(X_NF.inverse()) if isinstance(shape, Mesh) else None
        normal: Floats = demonstrated.normal if intent is None else np.eye(3)[intent.axis]
        walls = [] if mesh is None else _walls(mesh, normal)
        for _ in range(ERROR_DRAWS):
            if intent is None:
                plane = _perturbed(demonstrated, corners, rng, self._errors)
            else:
                plane = planned_plane(box, intent, rng, self._errors)
            distances = plane.distances(corners)
            if distances.min() >= 0.0 or distances.max() <= 0.0 or any(meets(plane, wall) for wall in walls):
                continue
            if mesh is None or not isinstance(slice_mesh(mesh, plane, MIN_SHARE), Missed):
                return plane
        return None

    @cached_property
    def _intents(self) -> dict[int, Intent | None]:
        return dict(intents_of(self._demonstration))


def _walls(mesh: Mesh, normal: Floats) -> list[Floats]:
    """Corners (n, 3) of the flat faces of `mesh` that are nearly perpendicular to `normal` (3,)."""
    facets = facets_of(mesh)
    surface = float(np.linalg.norm(np.cross(*np.diff(mesh.triangles, axis=1).transpose(1, 0, 2)), axis=1).sum()) / 2.0
    return [
        facet.triangles.reshape(-1, 3)
        for facet in facets
        if abs(float(facet.plane_F.normal @ normal)) > np.cos(np.radians(WALL_DEG))
        and facet.area >= WALL_SHARE * surface
    ]


def _perturbed(plane: Plane, corners: Floats, rng: np.random.Generator, errors: DemonstratorSettings) -> Plane:
    """`plane` with an error; it divides a shape with these corners (n, 3), which are given in the plane's frame."""
    distances = plane.distances(corners)
    spacing = max(0.0, min(float(distances.max()), -float(distances.min())))
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    point = middle + plane.normal * (spacing * errors.offset_error * error(rng) - float(plane.distances(middle)))
    tilt = np.radians(errors.tilt_error_deg * error(rng))
    across = np.cross(plane.normal, np.eye(3)[np.argmin(np.abs(plane.normal))])
    across /= np.linalg.norm(across)
    about = rng.uniform(0.0, 2.0 * np.pi)
    line = np.cos(about) * across + np.sin(about) * np.cross(plane.normal, across)
    return Plane.through(point, np.cos(tilt) * plane.normal + np.sin(tilt) * line)


EXPERT = Method(
    "expert",
    lambda context: ExpertPlanner(context.require_demonstration(), CAREFUL),
    description="a second demonstration with the demonstrator's error of 10 % and 2 degrees",
    kind="demonstration",
    sees_demonstration=True,
    position=0,
)
ROUGH_EXPERT = Method(
    "expert-rough",
    lambda context: ExpertPlanner(context.require_demonstration(), ROUGH),
    description="a second demonstration with an error of 30 % and 6 degrees",
    kind="demonstration",
    sees_demonstration=True,
    position=1,
)
