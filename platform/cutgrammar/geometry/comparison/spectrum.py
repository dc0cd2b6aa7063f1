"""A distance between surfaces based on Laplace-Beltrami eigenvalues, which TopoCut uses to compare fragments.

The eigenvalues are computed by the Rayleigh-Ritz method: among the polynomials in x, y, z up to `DEGREE`, restricted to
the surface, they are the stationary values of the Rayleigh quotient, the integral of the squared surface gradient
divided by the integral of the squared function. All integrands are polynomials on each triangle and are integrated
exactly. Up to rounding, the result therefore depends on the surface alone and not on pose, order or triangulation, and
slivers contribute in proportion to their area. On a sphere the first 24 eigenvalues are exact; otherwise they are upper
bounds of the true ones, and equal for equal surfaces.
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
"""Maximum total degree of the polynomials; there are 35 up to degree 4."""
COUNT = 8
"""Number of eigenvalues compared, not counting the zero of the constant function."""
MIN_NORM = 1e-10
"""Functions whose squared norm on the surface is below this share of the largest count as zero there."""


def frequencies(mesh: Mesh) -> Floats:
    """(COUNT,) square roots of the smallest nonzero eigenvalues of the Laplace-Beltrami operator, ascending [1/m].

    Args:
        mesh: closed, in any frame; rounding errors are smallest if its principal axes are the coordinate axes.

    Raises:
        ValueError: too few polynomials are linearly independent on a degenerate surface.
    """
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2.0
    spread = np.ptp(mesh.vertices, axis=0) / 2.0
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    crosses = np.cross(b - a, c - a)
    doubled = np.linalg.norm(crosses, axis=1)
    nonzero = doubled > 0.0
    normals = crosses[nonzero] / doubled[nonzero, None]
    along = (np.eye(3) - normals[:, :, None] * normals[:, None, :]) / np.outer(spread, spread)
    moments = _moments((mesh.triangles[nonzero] - middle) / spread, doubled[nonzero], *_rule())  # (m, d, d, d)
    mass_moments = moments.sum(axis=0).ravel()
    tangential = np.tensordot(along, moments, axes=(0, 0)).reshape(3, 3, -1)
    powers, sums = _polynomials()
    stiffness = np.zeros(sums.shape)
    for i, j in product(range(3), repeat=2):
        factors = np.outer(powers[:, i], powers[:, j])
        # If a factor is zero, its index in the table does not matter.
        stiffness += factors * tangential[i, j][np.maximum(sums - _index(np.eye(3)[i] + np.eye(3)[j]), 0)]
    return np.sqrt(np.maximum(_eigenvalues(stiffness, mass_moments[sums])[1 : COUNT + 1], 0.0))


def spectral_distance(a: Floats, b: Floats) -> float:
    """The distance between two surfaces with these frequencies (COUNT,), from 0 (equal) to 1.

    It is the mean over the frequencies of 1 - smaller / larger. Scaling a surface by 1.2 gives a distance of 1/6.
    """
    larger = np.maximum(a, b)
    return float(np.mean(1.0 - np.divide(np.minimum(a, b), larger, out=np.ones_like(larger), where=larger > 0.0)))


def _eigenvalues(stiffness: Floats, mass: Floats) -> Floats:
    """Generalised eigenvalues, ascending, in the space of functions that are not zero on the surface."""
    sizes, axes = eigh(mass)
    kept = sizes > MIN_NORM * sizes[-1]
    if kept.sum() <= COUNT:
        raise ValueError(f"only {kept.sum()} polynomials are independent on this surface; {COUNT + 1} are needed")
    white = axes[:, kept] / np.sqrt(sizes[kept])
    return np.asarray(eigh(white.T @ stiffness @ white, eigvals_only=True))


@njit(cache=True)
def _moments(triangles: Floats, doubled: Floats, nodes: Floats, weights: Floats) -> Floats:
    """(m, d, d, d) integrals of x^i y^j z^k over each triangle, up to total degree d - 1 = 2 `DEGREE`."""
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
    """(f, 3) powers of x, y and z of every function, and (f, f) indices of their products in a table of moments."""
    powers = np.array([p for p in product(range(DEGREE + 1), repeat=3) if sum(p) <= DEGREE])
    return powers, _index(powers[:, None] + powers)


def _index(powers: Floats | Ints) -> Ints:
    """Indices of these powers (..., 3) in a flattened table of moments (d, d, d)."""
    d = 2 * DEGREE + 1
    return np.asarray(powers @ np.array([d * d, d, 1]), dtype=np.int64)


@cache
def _rule() -> tuple[Floats, Floats]:
    """Nodes (q, 2), weights (q,): a rule exact up to degree 2 `DEGREE` on the triangle (0,0) (1,0) (0,1)."""
    u, by_u = roots_legendre(DEGREE + 1)
    v, by_v = roots_jacobi(DEGREE + 1, 1.0, 0.0)
    u, v = (u + 1.0) / 2.0, (v + 1.0) / 2.0
    first, second = np.meshgrid(u, v, indexing="ij")
    nodes = np.stack([first * (1.0 - second), second], axis=-1).reshape(-1, 2)
    weights = np.outer(by_u / 2.0, by_v / 4.0).ravel()
    return nodes, weights
