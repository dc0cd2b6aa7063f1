"""`expert` and `expert-rough`: second demonstrations, what the demonstrator would reach if asked to do it again.

Every cut is the demonstration's next one as it was meant (see `intents`), laid on the fragment at hand with a fresh
error: of 10 % of the spacing and 2 degrees as in the demonstrations, or of 30 % and 6 degrees. Where the intent cannot
be told, the demonstrated plane stands for it, and its distance from the nearer end of the fragment for the spacing. As
in the demonstrations an error is drawn again that makes the plane miss the fragment or meet a face left by an earlier
cut across the same axis.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from cutgrammar.demonstration import DemonstratedCut, Demonstration
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import FLIPS, canonical_frame
from cutgrammar.geometry.facets import facets_of
from cutgrammar.geometry.fragment import Cloud, Configuration, Mesh, corners_of
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Missed, slice_mesh
from cutgrammar.interfaces import Cut, Refusal, Stuck
from cutgrammar.methods.locating import Locator
from cutgrammar.methods.method import Method
from cutgrammar.settings import DemonstratorSettings
from cutgrammar_sim.demonstrator.intents import Intent, intents_of, plane_in_frame
from cutgrammar_sim.demonstrator.scripted_cuts import ERROR_DRAWS, SMALLEST_SHARE, error, meets, planned_plane

CAREFUL = DemonstratorSettings(offset_error=0.10, tilt_error_deg=2.0)
ROUGH = DemonstratorSettings(offset_error=0.30, tilt_error_deg=6.0)
BY_PLACE = 0.5
"""Weight of a fragment's distance from the demonstrated place when it is told which one it is (see `Locator`)."""
WALL_DEG, WALL_SHARE = 20.0, 0.02
"""A flat face is the wall left by a cut across an axis where its normal is within this angle of it [degrees] and it has
this share of the surface."""


class ExpertPlanner:
    """Carries out the cuts of a demonstration as they were meant, with errors of its own.

    Args:
        demonstration: what is done a second time.
        errors: how large the errors are.
    """

    def __init__(self, demonstration: Demonstration, errors: DemonstratorSettings) -> None:
        self._demonstration = demonstration
        self._errors = errors
        self._locator = Locator(demonstration, BY_PLACE)

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """The demonstration's next cut with a fresh error, also after a refusal; the goal is not looked at."""
        del goal, refused
        made, found = self._locator.locate(now)
        if made == len(self._locator.cuts):
            return Stuck("the demonstration has no further cut")
        cut = self._locator.cuts[made]
        if cut.fragment not in found:
            return Stuck(f"fragment {cut.fragment} of the demonstration is not there to be cut")
        fragment = now[found[cut.fragment]]
        X_NF = frame_like(fragment.shape, self._demonstration.fragments[cut.fragment].mesh)
        plane_F = self._drawn(cut, fragment.shape, X_NF, rng)
        if plane_F is None:
            return Stuck(f"none of {ERROR_DRAWS} planes drawn divides the fragment clear of its other cuts")
        return Cut(plane_F.transformed(fragment.X_WF @ X_NF), fragment.p_WC[None])

    def _drawn(self, cut: DemonstratedCut, shape: Mesh | Cloud, X_NF: Pose, rng: np.random.Generator) -> Plane | None:
        """A plane in F for `cut`, laid on `shape` whose frame is N; None if no error drawn gives one that cuts."""
        corners = X_NF.inverse().apply(corners_of(shape))
        box = corners.min(axis=0), corners.max(axis=0)
        intent = self._intents[cut.step]
        demonstrated = plane_in_frame(cut, self._demonstration.fragments[cut.fragment].mesh)
        mesh = shape.moved(X_NF.inverse()) if isinstance(shape, Mesh) else None
        normal: Floats = demonstrated.normal if intent is None else np.eye(3)[intent.axis]
        walls = [] if mesh is None else _walls(mesh, normal)
        for _ in range(ERROR_DRAWS):
            plane = self._once(intent, demonstrated, corners, box, rng)
            distances = plane.distances(corners)
            if distances.min() >= 0.0 or distances.max() <= 0.0 or any(meets(plane, wall) for wall in walls):
                continue
            if mesh is None or not isinstance(slice_mesh(mesh, plane, SMALLEST_SHARE), Missed):
                return plane
        return None

    def _once(
        self,
        intent: Intent | None,
        demonstrated: Plane,
        corners: Floats,
        box: tuple[Floats, Floats],
        rng: np.random.Generator,
    ) -> Plane:
        if intent is not None:
            return planned_plane(box, intent.axis, intent.first, intent.of, rng, self._errors)
        return _perturbed(demonstrated, corners, rng, self._errors)

    @cached_property
    def _intents(self) -> dict[int, Intent | None]:
        return dict(intents_of(self._demonstration))


def frame_like(shape: Mesh | Cloud, model: Mesh) -> Pose:
    """X_NF: where the frame F of the demonstrated fragment `model` stands in the frame N of the fragment at hand.

    Worlds that know their fragments leave a product in the frame it was cut in; then N is F. Where it is not, as with
    what was perceived, the canonical frames are laid upon each other, of their signs those that fit best. The fit is
    that of the boxes in F; canonical frames, noise for near-cubes, must fit twice as well to be preferred.
    """
    X_FC = canonical_frame(model)
    X_NC = canonical_frame(shape)
    own = [(_misfit(shape, X_NF, model), X_NF) for X_NF in (X_NC @ flip @ X_FC.inverse() for flip in FLIPS)]
    misfit, best = min(own, key=lambda pair: round(pair[0], 7))
    same = Pose.identity()
    return best if 2.0 * misfit < _misfit(shape, same, model) else same


def _misfit(shape: Mesh | Cloud, X_NF: Pose, model: Mesh) -> float:
    """Largest distance between the sides of the boxes in F of `shape` and `model` [m]."""
    seen = X_NF.inverse().apply(corners_of(shape))
    low, high = model.vertices.min(axis=0), model.vertices.max(axis=0)
    return float(max(np.abs(seen.min(axis=0) - low).max(), np.abs(seen.max(axis=0) - high).max()))


def _walls(mesh: Mesh, normal: Floats) -> list[Floats]:
    """Corners (n, 3) of the flat faces of `mesh` that lie across `normal` (3,) or nearly so."""
    facets = facets_of(mesh)
    surface = float(np.linalg.norm(np.cross(*np.diff(mesh.triangles, axis=1).transpose(1, 0, 2)), axis=1).sum()) / 2.0
    return [
        facet.triangles.reshape(-1, 3)
        for facet in facets
        if abs(float(facet.plane_F.normal @ normal)) > np.cos(np.radians(WALL_DEG))
        and facet.area >= WALL_SHARE * surface
    ]


def _perturbed(plane: Plane, corners: Floats, rng: np.random.Generator, errors: DemonstratorSettings) -> Plane:
    """`plane` with an error, in the frame of the `corners` (n, 3) of what it divides."""
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
    "a second demonstration with the demonstrator's error of 10 % and 2 degrees",
    kind="demonstration",
    sees_demonstration=True,
    position=0,
)
ROUGH_EXPERT = Method(
    "expert-rough",
    lambda context: ExpertPlanner(context.require_demonstration(), ROUGH),
    "a second demonstration with an error of 30 % and 6 degrees",
    kind="demonstration",
    sees_demonstration=True,
    position=1,
)
