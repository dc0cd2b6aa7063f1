"""Simulated scenes on which the segmentation of fused clouds is trained (IV-D).

A scene has one to three objects of training demonstrations: each is stretched a little along the axes of its frame, cut
by the first few of its demonstrated cuts and perhaps by some random ones, and laid on the board, where the fragments
settle as rigid bodies. There are three kinds of scenes, to cover the ways in which a world leaves fragments: `as cut`,
the fragments separated by the blade's thickness at every cut; `apart`, moved away from the middle of their object and
turned a little; `strewn`, turned at random and dropped side by side.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from cutgrammar.demonstration import Demonstration
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Sliced, slice_mesh
from cutgrammar.perception.vision.fused_cloud import LabelledCloud
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings
from cutgrammar_sim.cameras.look import look
from cutgrammar_sim.demonstrator.intents import plane_in_frame
from cutgrammar_sim.physics.hulls import HullError
from cutgrammar_sim.worlds.board import Board
from cutgrammar_sim.worlds.lying_fragments import shifted

KINDS, SHARES = ("as cut", "apart", "strewn"), (0.5, 0.25, 0.25)
"""Kinds of scenes and their probabilities."""
MAX_FRAGMENTS = 24
"""Maximum number of fragments of a scene."""
MAX_STRETCH = 0.12
"""Maximum relative stretch of an object along an axis of its frame."""
MAX_RANDOM_CUTS = 3
"""Maximum number of random cuts of an object after its demonstrated ones."""
MIN_SHARE = 0.02
"""A random cut with a product below this share of its fragment is left out."""
GAP = (0.008, 0.06)
"""Minimum and maximum distance between objects along y [m]."""
MAX_TRIES = 20
"""Maximum number of scenes drawn until one can be simulated and stays on the board."""
MAX_OFFSET = 0.22
"""A scene is drawn again if a fragment is farther than this from the middle of the board along x or y [m]."""


@dataclass(frozen=True, eq=False)
class _Part:
    """A fragment of an object in its frame F, and the shift (3,) by which its cuts have moved it in F [m]."""

    mesh: Mesh
    shift: Floats


def seen_scenes(
    demonstrations: Sequence[Demonstration],
    settings: Settings,
    seed: int,
    count: int,
    on_scene: Callable[[int], object] | None = None,
) -> list[LabelledCloud]:
    """Clouds of `count` scenes as the cameras see them, with the fragment to which each point belongs.

    Args:
        demonstrations: of the training trials.
        settings: of the world and of the cameras.
        seed: scene i depends only on the stream ("scene", i).
        count: number of scenes.
        on_scene: called with the number of finished scenes after each.
    """
    seen = []
    for i in range(count):
        rng = stream(seed, "scene", i)
        seen.append(look(make_scene(demonstrations, settings, rng), settings.cameras, rng))
        if on_scene is not None:
            on_scene(i + 1)
    return seen


def make_scene(
    demonstrations: Sequence[Demonstration], settings: Settings, rng: np.random.Generator, fragments: int | None = None
) -> Configuration:
    """A configuration at rest on the board.

    Args:
        demonstrations: sources of the objects and cuts.
        settings: of the world.
        rng: of all random draws.
        fragments: number of fragments; None draws one up to `MAX_FRAGMENTS`.

    Raises:
        ValueError: no demonstrations.
        RuntimeError: no scene could be simulated without leaving the board.
    """
    if not demonstrations:
        raise ValueError("scenes are made of the objects of demonstrations, but there are none")
    for _ in range(MAX_TRIES):
        n_fragments = int(rng.integers(1, MAX_FRAGMENTS + 1)) if fragments is None else fragments
        objects = _objects(demonstrations, n_fragments, settings.world.blade_thickness_mm * 1e-3, rng)
        start = _laid(objects, str(rng.choice(KINDS, p=SHARES)), rng)
        board = Board(settings.world)
        try:
            board.reset(start)
        except HullError:
            continue
        settled = board.truth()
        if all(np.abs(fragment.p_WC[:2]).max() < MAX_OFFSET for fragment in settled):
            return settled
    raise RuntimeError(f"none of {MAX_TRIES} scenes of {n_fragments} fragments stays on the board")


def _objects(
    demonstrations: Sequence[Demonstration], n_fragments: int, thickness: float, rng: np.random.Generator
) -> list[list[_Part]]:
    """One to three objects with `n_fragments` fragments in all."""
    number = int(rng.integers(1, min(3, n_fragments) + 1))
    objects: list[list[_Part]] = []
    for i in range(number):
        remaining = n_fragments - sum(len(parts) for parts in objects)
        share = remaining if i == number - 1 else max(1, remaining // (number - i))
        demonstration = demonstrations[int(rng.integers(len(demonstrations)))]
        stretch = 1.0 + rng.uniform(-MAX_STRETCH, MAX_STRETCH, size=3)
        objects.append(_cut_up(demonstration, stretch, share, thickness, rng))
    return objects


def _cut_up(
    demonstration: Demonstration, stretch: Floats, n_fragments: int, thickness: float, rng: np.random.Generator
) -> list[_Part]:
    """A stretched object of a demonstration, cut by demonstrated planes first and then by random ones."""
    start = demonstration.alive(0)
    parts = {int(rng.choice(start)): np.zeros(3)}
    n_random = int(rng.integers(MAX_RANDOM_CUTS + 1)) if rng.random() < 0.5 else 0
    for cut in demonstration.cuts:
        if cut.undone or cut.fragment not in parts or len(parts) >= max(n_fragments - n_random, 1):
            continue
        plane_F = plane_in_frame(cut, demonstration.fragments[cut.fragment].mesh)
        normal = plane_F.normal / stretch
        step = 0.5 * thickness * normal / np.linalg.norm(normal)
        shift = parts.pop(cut.fragment)
        for i in cut.products:
            above = plane_F.distances(demonstration.fragments[i].mesh.centroid) > 0.0
            parts[i] = shift + (step if above else -step)
    made = [
        _Part(Mesh(stretch * demonstration.fragments[i].mesh.vertices, demonstration.fragments[i].mesh.faces), shift)
        for i, shift in parts.items()
    ]
    for _ in range(10 * n_fragments):
        if len(made) >= n_fragments:
            break
        made = _cut_at_random(made, thickness, rng)
    return made


def _cut_at_random(parts: list[_Part], thickness: float, rng: np.random.Generator) -> list[_Part]:
    """The parts after one of the larger ones is cut by a plane near its middle, roughly across one of its axes."""
    volumes = np.array([part.mesh.volume for part in parts])
    chosen = int(rng.choice(len(parts), p=volumes / volumes.sum()))
    mesh = parts[chosen].mesh
    extents = np.ptp(mesh.vertices, axis=0)
    normal = np.eye(3)[int(rng.choice(3, p=extents / extents.sum()))] + rng.normal(scale=0.15, size=3)
    point = mesh.vertices.min(axis=0) + extents * rng.uniform(0.25, 0.75, size=3)
    plane = Plane.through(point, normal)
    sliced = slice_mesh(mesh, plane, MIN_SHARE)
    if not isinstance(sliced, Sliced):
        return parts
    step = 0.5 * thickness * plane.normal
    made = [_Part(m, parts[chosen].shift + step) for m in sliced.above]
    made += [_Part(m, parts[chosen].shift - step) for m in sliced.below]
    return parts[:chosen] + made + parts[chosen + 1 :]


def _laid(objects: list[list[_Part]], kind: str, rng: np.random.Generator) -> Configuration:
    """The fragments in the poses from which they settle."""
    if kind == "strewn":
        return _strewn([part.mesh for parts in objects for part in parts], rng)
    laid: list[Fragment] = []
    y = 0.0
    for parts in objects:
        turn = Rotation.from_euler("z", rng.normal(scale=20.0), degrees=True)
        if rng.random() < 0.3:
            turn = turn * Rotation.from_euler("x", rng.choice([90.0, 180.0, 270.0]), degrees=True)
        middle = np.mean([part.mesh.centroid for part in parts], axis=0)
        draw = rng.uniform(0.05, 0.6) if kind == "apart" else 0.0
        placed = []
        for part in parts:
            away = part.shift + draw * (part.mesh.centroid - middle)
            yaw = np.eye(3)
            if kind == "apart":
                away[:2] += rng.normal(scale=0.002, size=2)
                yaw = Rotation.from_euler("z", rng.normal(scale=8.0), degrees=True).as_matrix()
            about = turn.as_matrix()
            rotation = yaw @ about
            position = about @ (part.mesh.centroid + away) - rotation @ part.mesh.centroid
            placed.append(Fragment(part.mesh, Pose(rotation, position)))
        corners = np.concatenate([f.X_WF.apply(f.mesh.vertices) for f in placed])
        lowest, highest = corners.min(axis=0), corners.max(axis=0)
        y += float(rng.uniform(*GAP)) if laid else 0.0
        move = np.array([-(lowest[0] + highest[0]) / 2.0 + rng.normal(scale=0.02), y - lowest[1], -lowest[2]])
        laid += [shifted(fragment, move) for fragment in placed]
        y += highest[1] - lowest[1]
    return tuple(shifted(fragment, np.array([0.0, -y / 2.0, 0.0])) for fragment in laid)


def _strewn(meshes: Sequence[Mesh], rng: np.random.Generator) -> Configuration:
    """Each turned at random, just above the board, in rows that are as close as their sizes allow."""
    order = rng.permutation(len(meshes))
    side = int(np.ceil(np.sqrt(len(meshes))))
    laid: list[Fragment] = []
    y = 0.0
    for first in range(0, len(order), side):
        x, depth, row = 0.0, 0.0, []
        for i in order[first : first + side]:
            rotation = Rotation.random(rng=rng).as_matrix()
            corners = meshes[i].vertices @ rotation.T
            lowest, highest = corners.min(axis=0), corners.max(axis=0)
            row.append(Fragment(meshes[i], Pose(rotation, np.array([x, y, 0.002]) - lowest)))
            x += highest[0] - lowest[0] + rng.uniform(0.001, 0.02)
            depth = max(depth, highest[1] - lowest[1])
        laid += [shifted(fragment, np.array([-x / 2.0, 0.0, 0.0])) for fragment in row]
        y += depth + rng.uniform(0.001, 0.02)
    return tuple(shifted(fragment, np.array([0.0, -y / 2.0, 0.0])) for fragment in laid)
