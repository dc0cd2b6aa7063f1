"""Procedural foods: closed meshes of random proportions, each a pure function of its random stream.

Every food lies along x of its frame F with its centroid at the origin; its width is along y and its height along z.
There are two constructions, both without self-intersections:

- A tube consists of rings in planes across x, which are star-shaped about their centres and have the same angles. A
  section between two rings is therefore also star-shaped, with its corners in the same order. A banana is such a tube
  bent about an axis outside of it: the planes of its rings meet in this axis.
- A box whose surface is moved along the rays from its centre, so that each ray still meets it once.

A data set uses the foods of `PROPORTIONS` by default and those of `ON_REQUEST` only by name. The numbers of both are
part of a data set's definition; `demonstrator.definition_digest` covers those of the foods in use.
"""

from collections.abc import Callable
from types import MappingProxyType

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Mesh

PROPORTIONS = MappingProxyType(
    {
        # length, width, height [m]: minimum and maximum; the last number is the size of the shape noise
        "carrot": ((0.140, 0.165), (0.031, 0.037), (0.030, 0.036), 0.03),
        "cucumber": ((0.165, 0.200), (0.039, 0.046), (0.039, 0.045), 0.02),
        "potato": ((0.092, 0.112), (0.050, 0.058), (0.044, 0.050), 0.06),
        "courgette": ((0.160, 0.185), (0.043, 0.049), (0.042, 0.048), 0.02),
        "block": ((0.078, 0.096), (0.046, 0.053), (0.037, 0.043), 0.03),
    }
)
"""Length, width and height of every food, and its shape noise as a share of the radius."""

ON_REQUEST = MappingProxyType(
    {
        # the length of a banana is that of its bent centre line; its width is perpendicular to it
        "apple": ((0.066, 0.076), (0.074, 0.086), (0.072, 0.084), 0.03),
        "aubergine": ((0.140, 0.170), (0.066, 0.076), (0.062, 0.072), 0.03),
        "banana": ((0.175, 0.200), (0.028, 0.033), (0.027, 0.032), 0.02),
    }
)
"""The same for foods that are used only on request by name."""

BANANA_TURN_DEG = (150.0, 170.0)
"""Minimum and maximum angle between the ends of a banana [degrees]."""

RINGS, CORNERS = 18, 16
"""Rings of a tube and corners of a ring: 2 RINGS CORNERS = 576 triangles."""
GRID = (9, 5, 5)
"""Squares along the edges of a block: 4 (9 5 + 9 5 + 5 5) = 460 triangles."""
ROUND_GRID = (8, 8, 8)
"""Squares along the edges of the box that an apple is made from: 4 (8 8 + 8 8 + 8 8) = 768 triangles."""


def carrot(rng: np.random.Generator) -> Mesh:
    """A taper with a blunt top at +x and a rounded tip, slightly bent."""
    tip = rng.uniform(0.45, 0.6)
    return _tube(rng, "carrot", lambda u: tip + (1.0 - tip) * u**0.8, blunt=4.0, bend=0.02)


def cucumber(rng: np.random.Generator) -> Mesh:
    """An even tube with round ends, slightly bent."""
    return _tube(rng, "cucumber", lambda u: 0.92 + 0.08 * np.sin(np.pi * u), blunt=3.5, bend=0.03)


def potato(rng: np.random.Generator) -> Mesh:
    """A lumpy ellipsoid, flatter than wide."""
    return _tube(rng, "potato", np.ones_like, blunt=2.3, bend=0.0)


def courgette(rng: np.random.Generator) -> Mesh:
    """A tube slightly thicker towards +x, with blunt ends."""
    neck = rng.uniform(0.78, 0.88)
    return _tube(rng, "courgette", lambda u: neck + (1.0 - neck) * u**1.5, blunt=5.0, bend=0.015)


def block(rng: np.random.Generator) -> Mesh:
    """A box (tofu, cheese, ham) with slightly irregular sides."""
    vertices, faces = _box(GRID)
    *sides, noise = PROPORTIONS["block"]
    directions = vertices / np.linalg.norm(vertices, axis=1)[:, None]
    scale = 1.0 + 0.5 * noise * _waves(rng, directions)
    box = np.array([rng.uniform(*side) for side in sides])
    return _centred(0.5 * box * vertices * scale[:, None], faces)


def apple(rng: np.random.Generator) -> Mesh:
    """A ball with a hollow at the stalk (+x) and a smaller one at the other end."""
    *sides, noise = ON_REQUEST["apple"]
    vertices, faces = _box(ROUND_GRID)
    directions = vertices / np.linalg.norm(vertices, axis=1)[:, None]
    from_end = np.arccos(np.abs(directions[:, 0]).clip(0.0, 1.0))
    deep = np.where(directions[:, 0] > 0.0, rng.uniform(0.22, 0.32), rng.uniform(0.08, 0.16))
    radius = (1.0 - deep * np.exp(-((from_end / 0.45) ** 2))) * (1.0 + noise * _waves(rng, directions))
    ball = directions * radius[:, None]
    return _centred(np.array([rng.uniform(*side) for side in sides]) * ball / np.ptp(ball, axis=0), faces)


def aubergine(rng: np.random.Generator) -> Mesh:
    """A club shape: a slender round neck at -x and a thick body towards +x, slightly bent."""
    neck, middle = rng.uniform(0.38, 0.48), rng.uniform(0.35, 0.45)

    def profile(u: Floats) -> Floats:
        return np.asarray(neck + (1.0 - neck) / (1.0 + np.exp(-9.0 * (u - middle))))

    return _tube(rng, "aubergine", profile, blunt=2.8, bend=0.03)


def banana(rng: np.random.Generator) -> Mesh:
    """A tube bent in the x-y plane, with tapered ends that point to -y.

    It is bent so much that a single plane across y can divide it into three.
    """
    *sides, noise = ON_REQUEST["banana"]
    length, width, height = (rng.uniform(*side) for side in sides)
    half_turn = np.radians(rng.uniform(*BANANA_TURN_DEG)) / 2.0
    x, y, z = _rings(rng, lambda u: 0.62 + 0.38 * np.sin(np.pi * u), 3.0, noise, width, height)
    bow = 0.5 * length / half_turn  # radius of the bent centre line
    ends = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    straight = np.concatenate([np.stack([x, y, z], axis=-1).reshape(-1, 3), ends])
    turned, out = half_turn * straight[:, 0], bow + straight[:, 1]
    bent = np.stack([out * np.sin(turned), out * np.cos(turned), straight[:, 2]], axis=1)
    return _centred(bent, tube_faces())


def _tube(rng: np.random.Generator, name: str, profile: Callable[[Floats], Floats], blunt: float, bend: float) -> Mesh:
    """A tube along x.

    Args:
        rng: random stream of the food.
        name: name of the food in `PROPORTIONS` or `ON_REQUEST`.
        profile: radius as a share of the maximum, at shares (n,) of the length from -x to +x.
        blunt: exponent of the superellipse that closes the ends: 2 gives an ellipsoid, larger values blunter ends.
        bend: maximum sag of the centre line, as a share of the length.
    """
    *sides, noise = PROPORTIONS[name] if name in PROPORTIONS else ON_REQUEST[name]
    length, width, height = (rng.uniform(*side) for side in sides)
    x, y, z = _rings(rng, profile, blunt, noise, width, height)
    sag = rng.normal(0.0, bend / 2.0, size=2).clip(-bend, bend) * length
    y, z = sag[0] * (1.0 - x**2) + y, sag[1] * (1.0 - x**2) + z
    rings = np.stack([0.5 * length * x, y, z], axis=-1).reshape(-1, 3)
    poles = np.array([[-0.5 * length, 0.0, 0.0], [0.5 * length, 0.0, 0.0]])
    return _centred(np.concatenate([rings, poles]), tube_faces())


def _rings(
    rng: np.random.Generator,
    profile: Callable[[Floats], Floats],
    blunt: float,
    noise: float,
    width: float,
    height: float,
) -> tuple[Floats, Floats, Floats]:
    """Corners (RINGS, CORNERS) of a straight tube's rings: x as a share of half the length, y and z [m]."""
    # Rings are denser towards the ends, where the superellipse has its curvature; the poles are single vertices.
    along = -np.cos(np.pi * np.arange(1, RINGS + 1) / (RINGS + 1))
    closing = (1.0 - np.abs(along) ** blunt) ** (1.0 / blunt)
    radius = closing * profile((along + 1.0) / 2.0)
    angles = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    x, angle = np.meshgrid(along, angles, indexing="ij")
    waist = np.sqrt(np.maximum(1.0 - x**2, 0.0))  # directions on a sphere, so that the noise is smooth everywhere
    bumps = 1.0 + noise * _waves(rng, np.stack([x, waist * np.cos(angle), waist * np.sin(angle)], axis=-1))
    y = 0.5 * width * radius[:, None] * bumps * np.cos(angle)
    z = 0.5 * height * radius[:, None] * bumps * np.sin(angle)
    return x, y, z


def tube_faces(n_rings: int = RINGS, n_corners: int = CORNERS) -> Ints:
    """(m, 3) triangles of a tube whose vertices are ordered ring by ring, followed by the first and the last pole."""
    index = np.arange(n_rings * n_corners).reshape(n_rings, n_corners)
    after = np.roll(index, -1, axis=1)
    a, b, c, d = (part.ravel() for part in (index[:-1], index[1:], after[1:], after[:-1]))
    start = np.stack([np.full(n_corners, index.size), after[0], index[0]], axis=1)
    end = np.stack([np.full(n_corners, index.size + 1), index[-1], after[-1]], axis=1)
    return np.concatenate([np.stack([a, c, b], axis=1), np.stack([a, d, c], axis=1), start, end])


def _box(grid: tuple[int, int, int]) -> tuple[Floats, Ints]:
    """The surface of the box [-1, 1]^3, with its sides divided into squares of two triangles."""
    corners: dict[tuple[int, ...], int] = {}
    faces: list[tuple[int, int, int]] = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for end in (0, grid[axis]):
            for i, j in np.ndindex(grid[u], grid[v]):
                square = []
                for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1)):
                    place = [0, 0, 0]
                    place[axis], place[u], place[v] = end, i + di, j + dj
                    square.append(corners.setdefault(tuple(place), len(corners)))
                a, b, c, d = square if end else square[::-1]
                faces += [(a, b, c), (a, c, d)]
    return 2.0 * np.array(list(corners), dtype=np.float64) / np.array(grid) - 1.0, np.array(faces, dtype=np.int64)


def _waves(rng: np.random.Generator, directions: Floats) -> Floats:
    """Smooth low-frequency noise at directions (..., 3): a sum of four waves, mostly between -1 and 1."""
    total = np.zeros(directions.shape[:-1])
    for _ in range(4):
        wave = rng.normal(size=3)
        wave *= rng.uniform(1.0, 3.0) / np.sqrt((wave**2).sum())
        total += 0.5 * np.sin((directions * wave).sum(axis=-1) + rng.uniform(0.0, 2.0 * np.pi))
    return np.asarray(total)


def _centred(vertices: Floats, faces: Ints) -> Mesh:
    mesh = Mesh(vertices, faces)
    return Mesh(mesh.vertices - mesh.centroid, faces)
