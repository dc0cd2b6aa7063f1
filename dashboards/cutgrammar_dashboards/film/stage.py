"""The scene of a film: the board, the fragments in the colours of their foods, and the parts of a robot."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.camera import Camera, looking_at
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.motion import Link
from cutgrammar_dashboards.rendering.body import Body, body_of_mesh
from cutgrammar_dashboards.rendering.food_colours import face_colours, foods_after, largest_facet
from cutgrammar_dashboards.rendering.painting import TABLE_Z, paint
from cutgrammar_dashboards.rendering.scene import Pixels, Scene

FOCAL = 0.94
"""Focal length as a share of the width of a picture at 4:3."""
TOWARDS_CAMERA = np.array([0.72, -0.48, 0.50])
"""Direction from the fragments to the camera of key frames and goals, in W."""
FILLED = 0.8
"""The share of the width or the height of a close-up that its fragments fill."""
MIN_DISTANCE = 0.12
"""Of the camera of a close-up [m]."""
BOARD = (0.25, 0.30)
"""Half the extents of the board along x and y of W [m]."""
METAL, SHELL = np.array([0.80, 0.82, 0.84]), np.array([0.88, 0.89, 0.90])
DARK, WOOD = np.array([0.25, 0.27, 0.30]), np.array([0.74, 0.57, 0.38])

BLADES = ("blade", "knife")
"""Names of the parts that cut."""

PlacedLink = tuple[Link, Pose]
"""A part of a robot and its pose X_WL."""


class Stage:
    """Makes pictures of the configurations of one trial, which must be given in their order.

    Args:
        start: the initial configuration.
        foods: the food of each of its objects; if their numbers differ, all objects have a neutral colour.
    """

    def __init__(self, start: Configuration, foods: Sequence[str]) -> None:
        self._foods = tuple(foods) if len(foods) == len(start) else ("",) * len(start)
        self._last = start
        self._largest_facet = largest_facet(start)
        # Keyed by the mesh's identity and its material; the mesh is kept so that no other takes its identity.
        self._bodies: dict[tuple[int, str], tuple[Mesh, Body]] = {}

    def seen(self, camera: Camera, now: Configuration, links: Sequence[PlacedLink]) -> tuple[Ints, Ints]:
        """How many rays of a camera meet first each of the fragments (n,), and each of the parts of a robot (m,)."""
        bodies = [*self._on_board(now, ("",) * len(now)), *(self._part(link).placed(X) for link, X in links)]
        owner, _, _ = Scene(bodies).look(camera.X_WC.position, camera.rays_W.reshape(-1, 3))
        counts = np.bincount(owner[owner >= 0], minlength=len(bodies))[1:]
        return counts[: len(now)], counts[len(now) :]

    def picture(self, camera: Camera, now: Configuration, links: Sequence[PlacedLink] = ()) -> Pixels:
        """The picture that `camera` takes of the fragments and the parts of a robot."""
        self.follow(now)
        bodies = [*self._on_board(now, self._foods), *(self._part(link).placed(X) for link, X in links)]
        return paint(camera, bodies, slice(1, 1 + len(now)))

    def follow(self, now: Configuration) -> None:
        """Take note of a configuration that is not painted."""
        self._foods = foods_after(self._last, self._foods, now)
        self._last = now

    def goal_picture(
        self, goal: Configuration, width: int, height: int, towards_camera: Floats = TOWARDS_CAMERA
    ) -> Pixels:
        """The goal's fragments on a board of their own; those that are clouds are left out."""
        meshes = tuple(fragment for fragment in goal if isinstance(fragment.shape, Mesh))
        foods = foods_after(self._last, self._foods, meshes)
        camera = close_up(meshes, width, height, towards_camera)
        return paint(camera, self._on_board(meshes, foods), slice(1, None))

    def _on_board(self, now: Configuration, foods: Sequence[str]) -> list[Body]:
        return [self._board, *(self._fragment(f.mesh, food).placed(f.X_WF) for f, food in zip(now, foods, strict=True))]

    @cached_property
    def _board(self) -> Body:
        x, y = BOARD
        corners = np.array([[i * x, j * y, k] for i in (-1, 1) for j in (-1, 1) for k in (TABLE_Z, 0.0)])
        sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        faces = [half for a, b, c, d in sides for half in ((a, b, c), (a, c, d))]
        return body_of_mesh(Mesh(corners, np.array(faces)), WOOD, 0.05)

    def _fragment(self, mesh: Mesh, food: str) -> Body:
        key = id(mesh), food
        if key not in self._bodies:
            self._bodies[key] = mesh, body_of_mesh(mesh, face_colours(mesh, food, self._largest_facet), 0.25)
        return self._bodies[key][1]

    def _part(self, link: Link) -> Body:
        key = id(link.mesh), link.name
        if key not in self._bodies:
            colour, gloss = SHELL, 0.4
            if link.name in BLADES:
                colour, gloss = METAL, 1.0
            elif "gripper" in link.name or link.name in ("handle", "base"):
                colour, gloss = DARK, 0.4
            self._bodies[key] = link.mesh, body_of_mesh(link.mesh, colour, gloss)
        return self._bodies[key][1]


def camera_at(position: Floats, target: Floats, width: int, height: int, zoom: float = 1.0) -> Camera:
    """A camera at `position` (3,) that looks at `target` (3,) [m]; `zoom` multiplies its focal length."""
    return Camera(looking_at(position, target), width, height, zoom * FOCAL * min(width, height * 4.0 / 3.0))


def close_up(fragments: Sequence[Fragment], width: int, height: int, towards_camera: Floats = TOWARDS_CAMERA) -> Camera:
    """A camera whose picture the fragments fill, but for a margin.

    Args:
        fragments: to be seen; without any, it looks at the origin of W.
        width, height: of the picture [pixels].
        towards_camera: (3,) direction from the fragments to the camera in W, of any length.
    """
    corners = np.concatenate([np.zeros((0, 3)), *(f.X_WF.apply(f.mesh.vertices) for f in fragments)])
    low, high = (corners.min(axis=0), corners.max(axis=0)) if len(corners) else (np.zeros(3), np.zeros(3))
    middle, towards = (low + high) / 2.0, towards_camera / np.linalg.norm(towards_camera)
    camera = camera_at(middle + towards, middle, width, height)
    p_C = camera.X_WC.inverse().apply(corners)
    to_edge = FILLED * 0.5 * np.array([width, height]) / camera.focal
    nearest = (np.abs(p_C[:, :2]) / to_edge).max(axis=1) - (p_C[:, 2] - 1.0)  # at which a corner is on the edge
    return camera_at(middle + max(MIN_DISTANCE, *nearest, 0.0) * towards, middle, width, height)
