"""Pictures of fragments as pixels: a small software renderer, smooth where a surface is, with lines along its edges.

Every picture is seen by an eye infinitely far away, so sizes can be compared, and it is a pure function of what is
shown: no window, no graphics driver. A depth buffer decides what hides what, whatever the triangles look like.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar_dashboards.rendering.palette import Colour
from cutgrammar_dashboards.rendering.shading import shaded

FINER = 2
"""Pixels of the buffer along each side of a pixel of the picture."""
LIGHT = np.array([-0.35, -0.55, 0.85]) / np.linalg.norm([-0.35, -0.55, 0.85])
CREASE = 0.82
"""Cosine between the normals of neighbouring pixels below which a line is drawn."""


@dataclass(frozen=True, eq=False)
class Eye:
    """Where a picture is seen from.

    Attributes:
        towards: (3,) unit vector from what is shown to the eye.
    """

    towards: Floats

    @property
    def axes(self) -> Floats:
        """(2, 3) unit vectors to the right and upwards in the picture; z of the world points upwards."""
        right = np.cross([0.0, 0.0, 1.0], self.towards)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(self.towards, right)])


def eye_towards(*towards: float) -> Eye:
    """The eye in the direction of the vector (x, y, z)."""
    return Eye(np.array(towards) / np.linalg.norm(towards))


FRONT = eye_towards(0.45, -0.75, 0.62)
"""The board from the front, a little from the right and from above."""


@dataclass(frozen=True, eq=False)
class Body:
    """A surface with one colour.

    Attributes:
        vertices: (n, 3) [m].
        normals: (n, 3) unit normals at the vertices.
        faces: (m, 3) corners of every triangle.
        colour: of the whole.
    """

    vertices: Floats
    normals: Floats
    faces: Ints
    colour: Colour


@dataclass(frozen=True, eq=False)
class Picture:
    """Pixels and where they are.

    Attributes:
        pixels: (h, w, 4) red, green, blue, opacity, 0 to 255.
        density: pixels a metre.
        corner: (2,) place of the upper left corner along the eye's axes [m].
        eye: that saw it.
    """

    pixels: np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]
    density: float
    corner: Floats
    eye: Eye

    @property
    def size(self) -> tuple[float, float]:
        """Width and height [m]."""
        return self.pixels.shape[1] / self.density, self.pixels.shape[0] / self.density

    def place(self, p_W: Floats) -> Floats:
        """(n, 2) shares of width (from the left) and height (from the top) at which points (n, 3) [m] are seen."""
        seen = (np.atleast_2d(p_W) @ self.eye.axes.T - self.corner) * [1.0, -1.0]
        return np.asarray(seen / self.size)


def body_of(fragment: Fragment, colour: Colour, shift: Floats | None = None) -> Body:
    """A fragment where it lies in the world frame, moved by `shift` (3,) [m]; a cloud becomes small tetrahedra."""
    if isinstance(fragment.shape, Mesh):
        vertices, normals, faces = shaded(fragment.shape)
    else:
        vertices, normals, faces = _grains(fragment.shape.points, fragment.shape.normals)
    moved = fragment.X_WF.apply(vertices) + (0.0 if shift is None else shift)
    return Body(moved, fragment.X_WF.rotate(normals), faces, colour)


def render(bodies: Sequence[Body], eye: Eye, density: float) -> Picture:
    """The picture of `bodies`, just as large as they are.

    Args:
        bodies: what is shown.
        eye: from where.
        density: pixels a metre.

    Raises:
        ValueError: nothing to show.
    """
    if not bodies:
        raise ValueError("there is nothing to show")
    counts = [len(body.vertices) for body in bodies]
    offsets = np.cumsum([0, *counts[:-1]])
    vertices = np.concatenate([body.vertices for body in bodies])
    normals = np.concatenate([body.normals for body in bodies])
    faces = np.concatenate([body.faces + offset for body, offset in zip(bodies, offsets, strict=True)])
    owner = np.repeat(np.arange(len(bodies)), [len(body.faces) for body in bodies])
    seen = vertices @ eye.axes.T * [1.0, -1.0]
    margin = 1.5 / density
    low, high = seen.min(axis=0) - margin, seen.max(axis=0) + margin
    width, height = np.ceil((high - low) * density).astype(int)
    xy, far = (seen - low) * density * FINER, vertices @ eye.towards
    facing = _cross(*(xy[faces[:, i]] - xy[faces[:, 0]] for i in (1, 2))) < 0.0  # y points down in the picture
    faces, owner = faces[facing], owner[facing]
    pixel, triangle = _nearest(xy[faces], far[faces], width * FINER)
    weights = _weights(xy[faces[triangle]], np.stack([pixel % (width * FINER), pixel // (width * FINER)], axis=1) + 0.5)
    depth = np.einsum("ij,ij->i", weights, far[faces[triangle]])
    normal = np.einsum("ij,ijk->ik", weights, normals[faces[triangle]])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    shown = (height * FINER, width * FINER)
    drawn = _Buffer(shown, pixel, owner[triangle], depth, normal)
    colours = np.array([body.colour for body in bodies], dtype=np.float64)
    rgba = np.zeros((shown[0] * shown[1], 4))
    lines = drawn.lines(eye, 1.0 / (FINER * density))
    rgba[pixel, :3] = np.clip(colours[owner[triangle]] * (_lit(normal, eye) * lines[:, None]), 0.0, 255.0)
    rgba[pixel, 3] = 1.0
    rgba = rgba.reshape(height, FINER, width, FINER, 4).mean(axis=(1, 3))
    opacity = rgba[..., 3:]
    colour = np.divide(rgba[..., :3], opacity, out=np.zeros_like(rgba[..., :3]), where=opacity > 0.0)
    pixels = np.concatenate([colour, 255.0 * opacity], axis=2).round().astype(np.uint8)
    return Picture(pixels, density, low * [1.0, -1.0], eye)


@dataclass(frozen=True, eq=False)
class _Buffer:
    """What is nearest to the eye in every pixel covered.

    Attributes:
        shape: height and width of the buffer.
        pixel: (p,) numbers of the pixels covered.
        owner, depth, normal: (p,), (p,), (p, 3) of what is seen there.
    """

    shape: tuple[int, int]
    pixel: Ints
    owner: Ints
    depth: Floats
    normal: Floats

    def lines(self, eye: Eye, width: float) -> Floats:
        """(p,) how bright each pixel is drawn: darker along outlines, a little darker along edges.

        Args:
            eye: that sees it.
            width: of a pixel of the buffer [m].
        """
        facing = np.clip(self.normal @ eye.towards, 0.1, 1.0)
        slope = np.full(self.shape, np.inf)
        slope.flat[self.pixel] = width * np.sqrt(1.0 - facing**2) / facing
        owner, depth, normal = np.full(self.shape, -1), np.zeros(self.shape), np.zeros((*self.shape, 3))
        owner.flat[self.pixel], depth.flat[self.pixel] = self.owner, self.depth
        normal.reshape(-1, 3)[self.pixel] = self.normal
        outline, edge = np.zeros(self.shape, dtype=bool), np.zeros(self.shape, dtype=bool)
        for axis in (0, 1):
            here, there = ([slice(None)] * 2 for _ in range(2))
            here[axis], there[axis] = slice(None, -1), slice(1, None)
            a, b = tuple(here), tuple(there)
            apart = owner[a] != owner[b]
            apart |= np.abs(depth[a] - depth[b]) > 4.0 * width + 2.0 * np.maximum(slope[a], slope[b])
            bent = (normal[a] * normal[b]).sum(axis=2) < CREASE
            for side in (a, b):
                outline[side] |= apart
                edge[side] |= bent & ~apart
        return np.where(outline.flat[self.pixel], 0.42, np.where(edge.flat[self.pixel], 0.72, 1.0))


def _lit(normal: Floats, eye: Eye) -> Floats:
    """(p, 1) brightness of surfaces with these normals (p, 3): sky above, light from the left, a faint gloss."""
    half = LIGHT + eye.towards
    gloss = np.clip(normal @ (half / np.linalg.norm(half)), 0.0, 1.0) ** 24
    return np.asarray((0.60 + 0.10 * normal[:, 2] + 0.40 * np.clip(normal @ LIGHT, 0.0, 1.0) + 0.07 * gloss)[:, None])


def _nearest(corners: Floats, depths: Floats, width: int) -> tuple[Ints, Ints]:
    """The pixels whose centre a triangle covers, row by row, and which of the triangles is nearest to the eye there.

    Args:
        corners: (m, 3, 2) x (right), y (down) of the triangles, in pixels.
        depths: (m, 3) how near to the eye the corners are.
        width: of the buffer.

    Returns:
        (p,) numbers of the pixels, ascending, (p,) the triangles.
    """
    y = corners[..., 1]
    first = np.ceil(y.min(axis=1) - 0.5).astype(int)
    rows = np.maximum(np.floor(y.max(axis=1) - 0.5).astype(int) - first + 1, 0)
    triangle, row = _counted(rows, first)
    low, high = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    for i in range(3):
        a, b = corners[triangle, i], corners[triangle, (i + 1) % 3]
        rise = b[:, 1] - a[:, 1]
        share = np.divide(row + 0.5 - a[:, 1], rise, out=np.full(len(row), -1.0), where=rise != 0.0)
        x = a[:, 0] + share * (b[:, 0] - a[:, 0])
        met = (share >= 0.0) & (share <= 1.0)
        low, high = np.where(met, np.minimum(low, x), low), np.where(met, np.maximum(high, x), high)
    met = low <= high
    triangle, row, low, high = triangle[met], row[met], low[met], high[met]
    left = np.maximum(np.ceil(low - 0.5 - 1e-6).astype(int), 0)
    columns = np.maximum(np.minimum(np.floor(high - 0.5 + 1e-6).astype(int), width - 1) - left + 1, 0)
    span, column = _counted(columns, left)
    # Depth is linear over a triangle; slivers, whose slope is noise, are held between their corners.
    ends = _weights(corners[triangle], np.stack([left + 0.5, row + 0.5], axis=1))
    more = _weights(corners[triangle], np.stack([left + np.maximum(columns, 1) - 0.5, row + 0.5], axis=1))
    begin, end = ((w * depths[triangle]).sum(axis=1) for w in (ends, more))
    slope = (end - begin) / np.maximum(columns - 1, 1)
    depth = begin[span] + slope[span] * (column - left[span])
    pixel, triangle = row[span] * width + column, triangle[span]
    order = np.lexsort((triangle, depth, pixel))
    nearest = order[np.flatnonzero(np.diff(pixel[order], append=-1))]
    return pixel[nearest], triangle[nearest]


def _weights(corners: Floats, p: Floats) -> Floats:
    """(p, 3) weights of the corners (p, 3, 2) of triangles that make the points (p, 2), none of them negative."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    area = _cross(b - a, c - a)
    safe = np.where(np.abs(area) > 1e-12, area, 1.0)
    second, third = _cross(p - a, c - a) / safe, _cross(b - a, p - a) / safe
    weights = np.clip(np.stack([1.0 - second - third, second, third], axis=1), 0.0, 1.0)
    return np.asarray(weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-12))


def _counted(counts: Ints, first: Ints) -> tuple[Ints, Ints]:
    """Which entry each of its `counts` numbers belongs to, and the numbers: `first`, `first` + 1, and so on."""
    entry = np.repeat(np.arange(len(counts)), counts)
    return entry, np.arange(len(entry)) - np.repeat(np.cumsum(counts) - counts, counts) + first[entry]


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _grains(points: Floats, normals: Floats) -> tuple[Floats, Floats, Ints]:
    """Points as tetrahedra, small against the distance between neighbours: vertices, normals, faces."""
    size = 0.6 * float(np.ptp(points, axis=0).max()) / np.sqrt(len(points))
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)
    vertices = (points[:, None] + size * corners).reshape(-1, 3)
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    return vertices, np.repeat(normals, 4, axis=0), (4 * np.arange(len(points))[:, None, None] + faces).reshape(-1, 3)
