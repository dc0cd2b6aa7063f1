"""How alike two surfaces vibrate: a distance of Laplace-Beltrami eigenvalues, as TopoCut compares fragments by them.

Eigenvalues are those of Rayleigh and Ritz: of all functions on the surface that are polynomials of x, y, z up to
`DEGREE`, those at which the Rayleigh quotient, the integral of the squared surface gradient over that of the squared
function, is stationary. Every integrand is a polynomial on each triangle and its integral is exact, so the result is a
property of the surface: neither pose, nor order, nor how the surface is divided into triangles changes it beyond
rounding, and a sliver counts for no more than its area. On a sphere the eigenvalues up to the 24th are exact; else they
lie above the true ones, the same for like surfaces.
"""

from functools import cache
from itertools import product

import numpy as np
from numba import njit
from scipy.linalg import eigh
from scipy.special import roots_jacobi, roots_legendre

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Mesh

DEGREE = 4
"""Total degree of the polynomials; there are 35 up to the fourth."""
COUNT = 8
"""Number of eigenvalues compared, without the zero of the constant function."""
DEPENDENT = 1e-10
"""Functions whose integral square on the surface is under this share of the largest count as zero there."""


def frequencies(mesh: Mesh) -> Floats:
    """(COUNT,) square roots of the lowest eigenvalues of the Laplace-Beltrami operator but the first, ascending [1/m].

    Args:
        mesh: closed, in any frame; numbers are most exact where its box stands along its principal axes.

    Raises:
        ValueError: a surface so degenerate that too few polynomials differ on it.
    """
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2.0
    spread = np.ptp(mesh.vertices, axis=0) / 2.0
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    crosses = np.cross(b - a, c - a)
    doubled = np.linalg.norm(crosses, axis=1)
    solid = doubled > 0.0
    normals = crosses[solid] / doubled[solid, None]
    along = (np.eye(3) - normals[:, :, None] * normals[:, None, :]) / np.outer(spread, spread)
    moments = _moments((mesh.triangles[solid] - middle) / spread, doubled[solid], *_rule())  # (m, d, d, d)
    whole = moments.sum(axis=0).ravel()
    tangential = np.tensordot(along, moments, axes=(0, 0)).reshape(3, 3, -1)
    powers, sums = _polynomials()
    stiffness = np.zeros(sums.shape)
    for i, j in product(range(3), repeat=2):
        factors = np.outer(powers[:, i], powers[:, j])
        # Where a factor is zero the place in the table is of no matter.
        stiffness += factors * tangential[i, j][np.maximum(sums - _place(np.eye(3)[i] + np.eye(3)[j]), 0)]
    return np.sqrt(np.maximum(_eigenvalues(stiffness, whole[sums])[1 : COUNT + 1], 0.0))


def spectral_distance(a: Floats, b: Floats) -> float:
    """How far apart two surfaces with these frequencies (COUNT,) are, from 0 (the same) to 1.

    The mean over the frequencies of 1 - smaller / larger; a surface 20 % larger than another of its shape is 1/6 away.
    """
    larger = np.maximum(a, b)
    return float(np.mean(1.0 - np.divide(np.minimum(a, b), larger, out=np.ones_like(larger), where=larger > 0.0)))


def _eigenvalues(stiffness: Floats, mass: Floats) -> Floats:
    """Of the pencil, ascending, among the functions that are not zero on the surface."""
    sizes, axes = eigh(mass)
    kept = sizes > DEPENDENT * sizes[-1]
    if kept.sum() <= COUNT:
        raise ValueError(f"only {kept.sum()} polynomials differ on this surface; {COUNT + 1} are needed")
    white = axes[:, kept] / np.sqrt(sizes[kept])
    return np.asarray(eigh(white.T @ stiffness @ white, eigvals_only=True))


@njit(cache=True)
def _moments(triangles: Floats, doubled: Floats, nodes: Floats, weights: Floats) -> Floats:
    """(m, d, d, d) integrals over each triangle of x^i y^j z^k up to total degree d - 1 = 2 `DEGREE`, zero beyond."""
    d = 2 * DEGREE + 1
    moments = np.zeros((len(triangles), d, d, d))
    x, y, z = np.ones(d), np.ones(d), np.ones(d)
    for t in range(len(triangles)):
        a, b, c = triangles[t]
        for q in range(len(nodes)):
            u, v = nodes[q]
            for n in range(1, d):
                x[n] = x[n - 1] * (a[0] + u * (b[0] - a[0]) + v * (c[0] - a[0]))
                y[n] = y[n - 1] * (a[1] + u * (b[1] - a[1]) + v * (c[1] - a[1]))
                z[n] = z[n - 1] * (a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2]))
            for i in range(d):
                for j in range(d - i):
                    factor = doubled[t] * weights[q] * x[i] * y[j]
                    for k in range(d - i - j):
                        moments[t, i, j, k] += factor * z[k]
    return moments


@cache
def _polynomials() -> tuple[Ints, Ints]:
    """(f, 3) powers of x, y and z of every function, and (f, f) the places of their products in a table of moments."""
    powers = np.array([p for p in product(range(DEGREE + 1), repeat=3) if sum(p) <= DEGREE])
    return powers, _place(powers[:, None] + powers)


def _place(powers: Floats | Ints) -> Ints:
    """Places in a flat table of moments (d, d, d) of these powers (..., 3)."""
    d = 2 * DEGREE + 1
    return np.asarray(powers @ np.array([d * d, d, 1]), dtype=np.int64)


@cache
def _rule() -> tuple[Floats, Floats]:
    """Nodes (q, 2) and weights (q,) that integrate polynomials up to 2 `DEGREE` over the triangle (0,0) (1,0) (0,1)."""
    u, by_u = roots_legendre(DEGREE + 1)
    v, by_v = roots_jacobi(DEGREE + 1, 1.0, 0.0)
    u, v = (u + 1.0) / 2.0, (v + 1.0) / 2.0
    first, second = np.meshgrid(u, v, indexing="ij")
    nodes = np.stack([first * (1.0 - second), second], axis=-1).reshape(-1, 2)
    weights = np.outer(by_u / 2.0, by_v / 4.0).ravel()
    return nodes, weights
