"""Whether arm, tool and what it carries touch anything: fragments, the board, or one another.

Towards fragments and board, capsules count as rows of balls and the blade and a carried fragment as points, all held
against a map of heights. Among themselves capsules are compared exactly; the blade counts as a few thin ones. Pairs of
neighbouring links, and pairs that touch when the arm is at home, are left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar_sim.arm.planning.height_map import Heights
from cutgrammar_sim.arm.robot.description import X_WA, Arm, Capsule
from cutgrammar_sim.arm.robot.kinematics import link_poses
from cutgrammar_sim.arm.robot.tool import Tool

FIXED = 2
"""The first links, which stand behind the board and go nowhere near it, are not held against it."""
BLADE_POINTS = 8e-3
"""Between the points that stand for the blade [m]."""
BLADE_RADIUS = 2e-3
"""Of the balls about them [m]."""
CLOSE = 2e-3
"""Least distance between parts of arm and tool [m]."""


@dataclass(frozen=True, eq=False)
class _Balls:
    """Balls about points of the links; the flange counts as one more.

    Attributes:
        link: (k,) which link each belongs to.
        p_LM: (k, 3) middles [m].
        radius: (k,) which of `radii`.
        radii: of all balls [m].
    """

    link: Ints
    p_LM: Floats
    radius: Ints
    radii: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class _Segments:
    """Capsules of the links, and which pairs of them are to be compared.

    Attributes:
        link: (k,) which link each belongs to.
        ends: (k, 2, 3) [m].
        radius: (k,) [m].
        pairs: (m, 2).
    """

    link: Ints
    ends: Floats
    radius: Floats
    pairs: Ints


class CollisionChecker:
    """An arm with a tool, as far as it can touch something."""

    def __init__(self, arm: Arm, tool: Tool) -> None:
        self._arm = arm
        self._X_LT = np.eye(4)
        self._X_LT[:3, :3], self._X_LT[:3, 3] = arm.X_LT.rotation, arm.X_LT.position
        self._X_WA = np.eye(4)
        self._X_WA[:3, :3], self._X_WA[:3, 3] = X_WA.rotation, X_WA.position
        flange = len(arm.links)
        blade = _blade_points(tool)
        covers = [(i, c) for i, link in enumerate(arm.links) for c in link.capsules]
        self._balls: dict[tuple[bool, bool], _Balls] = {}
        self._segments: dict[bool, _Segments] = {}
        for out in (False, True):
            tools = [(flange, tool.handle), (flange, tool.gripper_out if out else tool.gripper_in)]
            rows = [(i, c) for i, c in covers if i >= FIXED] + tools
            self._balls[out, False] = _balls(rows, [])
            self._balls[out, True] = _balls(rows, [(flange, blade, BLADE_RADIUS)])
            everything = covers + tools + [(flange, c) for c in _blade_capsules(tool, 4)]
            self._segments[out] = self._compared(everything, flange, arm.home)
        X_TL = arm.X_LT.inverse()
        last = [Capsule(X_TL.apply(c.ends), c.radius) for c in arm.links[-1].capsules]
        self._knife = [tool.handle, *_blade_capsules(tool, int(np.ceil(tool.height / BLADE_POINTS)) + 1), *last]

    def places(self, q: Floats) -> Floats:
        """(t, n + 2, 4, 4) X_WL of the links and, last, X_WT of the flange, for the postures q (t, n)."""
        return self._places(np.ascontiguousarray(q, dtype=np.float64))

    def free(
        self,
        q: Floats,
        heights: Heights,
        margin: float,
        gripper_out: bool = False,
        blade: bool = True,
        held: Floats | None = None,
    ) -> bool:
        """Whether nothing touches in any of some postures.

        Args:
            q: (t, n) postures [rad].
            heights: what stands on the board.
            margin: distance to keep from it and from the board [m].
            gripper_out: the gripper is come out.
            blade: the blade, too, is to keep clear of what stands on the board.
            held: (k, 3) points in T of a fragment that is carried, which touches nothing, too [m].
        """
        X_WL = self._places(np.ascontiguousarray(q, dtype=np.float64))
        segments = self._segments[gripper_out]
        if not _apart(X_WL, segments.link, segments.ends, segments.radius, segments.pairs, CLOSE):
            return False
        balls = self._balls[gripper_out, blade]
        if not self._above(X_WL, balls, heights, margin):
            return False
        if held is None:
            return True
        flange = X_WL.shape[1] - 1
        points = _Balls(np.full(len(held), flange), held, np.zeros(len(held), dtype=np.int64), (0.0,))
        links = segments.link < flange - 1  # the last and the tool move with it, see `clear_of`
        return self._above(X_WL, points, heights, margin) and bool(
            _points_apart(X_WL, held, segments.link[links], segments.ends[links], segments.radius[links] + CLOSE)
        )

    def clear_of(self, points_T: Floats) -> bool:
        """Whether points (k, 3) in T of what the gripper holds are clear of the knife and of the last link."""
        still = np.tile(np.eye(4), (1, 1, 1, 1))
        link = np.zeros(len(self._knife), dtype=np.int64)
        ends = np.array([c.ends for c in self._knife])
        return bool(_points_apart(still, points_T, link, ends, np.array([c.radius + CLOSE for c in self._knife])))

    def _places(self, q: Floats) -> Floats:
        X_AL = link_poses(self._arm, q)
        X_AT = X_AL[:, -1:] @ self._X_LT
        return np.ascontiguousarray(self._X_WA @ np.concatenate([X_AL, X_AT], axis=1))

    def _above(self, X_WL: Floats, balls: _Balls, heights: Heights, margin: float) -> bool:
        maps = np.array([heights.grown(radius + margin) for radius in balls.radii])
        lifts = np.array(balls.radii) + margin
        return bool(_clears(X_WL, balls.link, balls.p_LM, balls.radius, lifts, maps, heights.low, heights.cell))

    def _compared(self, rows: Sequence[tuple[int, Capsule]], flange: int, home: Floats) -> _Segments:
        link = np.array([i for i, _ in rows])
        ends = np.array([c.ends for _, c in rows])
        radius = np.array([c.radius for _, c in rows])
        X_WL = self._places(np.ascontiguousarray(home[None]))
        pairs = []
        for a in range(len(rows)):
            for b in range(a + 1, len(rows)):
                near = link[b] - link[a] <= 1 or (link[b] == flange and link[a] >= flange - 2)
                pair = np.array([[a, b]])
                if not near and _apart(X_WL, link, ends, radius, pair, CLOSE):
                    pairs.append((a, b))
        return _Segments(link, ends, radius, np.array(pairs, dtype=np.int64).reshape(-1, 2))


def _balls(rows: Sequence[tuple[int, Capsule]], points: Sequence[tuple[int, Floats, float]]) -> _Balls:
    """Balls that cover capsules, each a little larger than its capsule so that nothing shows between them."""
    parts = [(i, *_row(capsule)) for i, capsule in rows] + list(points)
    radii = sorted({radius for _, _, radius in parts})
    return _Balls(
        np.concatenate([np.full(len(p), i) for i, p, _ in parts]),
        np.concatenate([p for _, p, _ in parts]),
        np.concatenate([np.full(len(p), radii.index(radius)) for _, p, radius in parts]),
        tuple(radii),
    )


def _row(capsule: Capsule) -> tuple[Floats, float]:
    a, b = capsule.ends
    count = int(np.ceil(np.linalg.norm(b - a) / (0.6 * capsule.radius))) + 1
    return a + np.linspace(0.0, 1.0, count)[:, None] * (b - a), round(capsule.radius / np.sqrt(1.0 - 0.3**2), 9)


def _blade_points(tool: Tool) -> Floats:
    """(k, 3) points in T all over the blade."""
    y = np.linspace(-tool.length / 2.0, tool.length / 2.0, int(np.ceil(tool.length / BLADE_POINTS)) + 1)
    z = np.linspace(0.0, tool.height, int(np.ceil(tool.height / BLADE_POINTS)) + 1)
    grid = np.stack(np.meshgrid([0.0], y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    return tool.X_TB.apply(grid)


def _blade_capsules(tool: Tool, lines: int) -> list[Capsule]:
    half, radius = tool.length / 2.0, 0.004
    return [
        Capsule(tool.X_TB.apply(np.array([[0.0, -half, z], [0.0, half, z]])), radius)
        for z in np.linspace(0.0, tool.height, lines)
    ]


# --- compiled ---------------------------------------------------------------------------------------------------------


@njit(cache=True)
def _clears(
    X_WL: Floats, link: Ints, p_LM: Floats, radius: Ints, lifts: Floats, maps: Floats, low: Floats, cell: float
) -> bool:
    """Whether every ball is above the map grown by its radius and margin, in every posture."""
    _, rows, columns = maps.shape
    for k in range(X_WL.shape[0]):
        for m in range(link.size):
            X = X_WL[k, link[m]]
            x = X[0, 0] * p_LM[m, 0] + X[0, 1] * p_LM[m, 1] + X[0, 2] * p_LM[m, 2] + X[0, 3]
            y = X[1, 0] * p_LM[m, 0] + X[1, 1] * p_LM[m, 1] + X[1, 2] * p_LM[m, 2] + X[1, 3]
            z = X[2, 0] * p_LM[m, 0] + X[2, 1] * p_LM[m, 1] + X[2, 2] * p_LM[m, 2] + X[2, 3]
            i = int(np.floor((x - low[0]) / cell))
            j = int(np.floor((y - low[1]) / cell))
            i = min(max(i, 0), rows - 1)
            j = min(max(j, 0), columns - 1)
            if z - lifts[radius[m]] < maps[radius[m], i, j]:
                return False
    return True


@njit(cache=True)
def _at(X: Floats, p: Floats, out: Floats) -> None:
    for a in range(3):
        out[a] = X[a, 0] * p[0] + X[a, 1] * p[1] + X[a, 2] * p[2] + X[a, 3]


@njit(cache=True)
def _apart(X_WL: Floats, link: Ints, ends: Floats, radius: Floats, pairs: Ints, close: float) -> bool:
    """Whether the capsules of every pair are more than `close` apart, in every posture."""
    world = np.empty((link.size, 2, 3))
    for k in range(X_WL.shape[0]):
        for m in range(link.size):
            _at(X_WL[k, link[m]], ends[m, 0], world[m, 0])
            _at(X_WL[k, link[m]], ends[m, 1], world[m, 1])
        for m in range(pairs.shape[0]):
            a, b = pairs[m, 0], pairs[m, 1]
            least = radius[a] + radius[b] + close
            if _segments_squared(world[a], world[b]) < least * least:
                return False
    return True


@njit(cache=True)
def _segments_squared(a: Floats, b: Floats) -> float:
    """The squared distance between two segments (2, 3)."""
    uu = uv = vv = uw = vw = 0.0
    for i in range(3):
        u, v, w = a[1, i] - a[0, i], b[1, i] - b[0, i], a[0, i] - b[0, i]
        uu += u * u
        uv += u * v
        vv += v * v
        uw += u * w
        vw += v * w
    apart = uu * vv - uv * uv
    s = min(max((uv * vw - vv * uw) / apart, 0.0), 1.0) if apart > 1e-12 * uu * vv else 0.0
    t = (uv * s + vw) / vv if vv > 0.0 else 0.0
    if t < 0.0 or t > 1.0 or vv == 0.0:
        t = min(max(t, 0.0), 1.0)
        s = min(max((uv * t - uw) / uu, 0.0), 1.0) if uu > 0.0 else 0.0
    total = 0.0
    for i in range(3):
        d = a[0, i] - b[0, i] + s * (a[1, i] - a[0, i]) - t * (b[1, i] - b[0, i])
        total += d * d
    return total


@njit(cache=True)
def _points_apart(X_WL: Floats, points_T: Floats, link: Ints, ends: Floats, reach: Floats) -> bool:
    """Whether points (k, 3) fixed to the last frame are farther than `reach` from segments, in every posture."""
    p, pair = np.empty(3), np.empty((2, 3))
    world = np.empty((link.size, 2, 3))
    flange = X_WL.shape[1] - 1
    middle, far = np.zeros(3), 0.0  # of a ball about all points
    for n in range(points_T.shape[0]):
        middle += points_T[n] / points_T.shape[0]
    for n in range(points_T.shape[0]):
        far = max(far, np.sqrt(((points_T[n] - middle) ** 2).sum()))
    near = np.empty(link.size, dtype=np.bool_)
    for k in range(X_WL.shape[0]):
        for m in range(link.size):
            _at(X_WL[k, link[m]], ends[m, 0], world[m, 0])
            _at(X_WL[k, link[m]], ends[m, 1], world[m, 1])
        _at(X_WL[k, flange], middle, p)
        pair[0], pair[1] = p, p
        some = False
        for m in range(link.size):
            near[m] = _segments_squared(world[m], pair) < (reach[m] + far) ** 2
            some = some or near[m]
        if not some:
            continue
        for n in range(points_T.shape[0]):
            _at(X_WL[k, flange], points_T[n], p)
            pair[0], pair[1] = p, p
            for m in range(link.size):
                if near[m] and _segments_squared(world[m], pair) < reach[m] * reach[m]:
                    return False
    return True
