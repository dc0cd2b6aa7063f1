"""The inner loops of the renderer, compiled: over the rays that meet a surface, and over the pixels of a picture.

With numpy each step of a loop writes an array as large as the picture, which took three quarters of a film's time.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cutgrammar.geometry.arrays import Floats, Ints


@njit(cache=True, nogil=True)
def surfaces_at(
    rays: Ints,
    origins: Floats,
    directions: Floats,
    distance: NDArray[np.float32],
    uv: NDArray[np.float32],
    across: NDArray[np.float32],
    corner_normals: Floats,
) -> tuple[Floats, Floats, Floats, Floats]:
    """The surface where rays meet it.

    Args:
        rays: (k,) indices of the rays that meet something.
        origins: (n, 3) or, of all rays, (1, 3) [m].
        directions: (n, 3), of any length.
        distance: (n,) to the surface in lengths of the directions.
        uv: (n, 2) barycentric weights of the second and third corner.
        across: (n, 3) normals of the triangles, of any length.
        corner_normals: (k, 3, 3) unit normals at the three corners of the triangles that are met.

    Returns:
        (k, 3) points [m], unit vectors towards the eye, and unit normals of the triangles and of the smooth surfaces,
        on the side of the eye.
    """
    n = len(rays)
    points, to_eye, flat, normals = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    for k in range(n):
        i = rays[k]
        start = origins[i if len(origins) > 1 else 0]
        u, v, t = float(uv[i, 0]), float(uv[i, 1]), float(distance[i])
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        fx, fy, fz = float(across[i, 0]), float(across[i, 1]), float(across[i, 2])
        size = max(math.sqrt(fx * fx + fy * fy + fz * fz), 1e-300)
        if fx * dx + fy * dy + fz * dz > 0.0:
            size = -size
        fx, fy, fz = fx / size, fy / size, fz / size
        corners = corner_normals[k]
        w = 1.0 - u - v
        nx = w * corners[0, 0] + u * corners[1, 0] + v * corners[2, 0]
        ny = w * corners[0, 1] + u * corners[1, 1] + v * corners[2, 1]
        nz = w * corners[0, 2] + u * corners[1, 2] + v * corners[2, 2]
        size = max(math.sqrt(nx * nx + ny * ny + nz * nz), 1e-300)
        if nx * fx + ny * fy + nz * fz < 0.0:
            size = -size
        normals[k, 0], normals[k, 1], normals[k, 2] = nx / size, ny / size, nz / size
        flat[k, 0], flat[k, 1], flat[k, 2] = fx, fy, fz
        points[k, 0], points[k, 1], points[k, 2] = start[0] + t * dx, start[1] + t * dy, start[2] + t * dz
        size = -max(math.sqrt(dx * dx + dy * dy + dz * dz), 1e-300)
        to_eye[k, 0], to_eye[k, 1], to_eye[k, 2] = dx / size, dy / size, dz / size
    return points, to_eye, flat, normals


@njit(cache=True, nogil=True)
def reflected(
    normals: Floats,
    to_eye: Floats,
    colours: Floats,
    gloss: Floats,
    lit: NDArray[np.bool_],
    towards: Floats,
    lamp: Floats,
    above: Floats,
    below: Floats,
    shininess: float,
) -> Floats:
    """(n, 3) light that surfaces send to the eye: diffuse, of the surroundings, and highlights (after Blinn).

    Args:
        normals, to_eye: (n, 3) unit vectors.
        colours: (n, 3) in the units in which light adds up.
        gloss: (n,) strength of highlights.
        lit: (n,) whether the lamp reaches them.
        towards: (3,) unit vector towards the lamp.
        lamp, above, below: (3,) colours of the lamp and of the light from above and from below.
        shininess: exponent of highlights.
    """
    result = np.empty((len(normals), 3))
    for i in range(len(normals)):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        facing, highlight = 0.0, 0.0
        if lit[i]:
            facing = nx * towards[0] + ny * towards[1] + nz * towards[2]
            if gloss[i] > 0.0:
                hx, hy, hz = towards[0] + to_eye[i, 0], towards[1] + to_eye[i, 1], towards[2] + to_eye[i, 2]
                size = max(math.sqrt(hx * hx + hy * hy + hz * hz), 1e-300)
                cosine = min(max((nx * hx + ny * hy + nz * hz) / size, 0.0), 1.0)
                highlight = 0.5 * gloss[i] * cosine**shininess
        upward = 0.5 + 0.5 * nz
        for c in range(3):
            ambient = upward * above[c] + (1.0 - upward) * below[c]
            result[i, c] = colours[i, c] * (facing * lamp[c] + ambient) + highlight
    return result


@njit(cache=True, nogil=True)
def contrasting(light: Floats, contrast: float) -> NDArray[np.bool_]:
    """(height, width) whether pixels of `light` (height, width, 3) differ by more than `contrast` from a neighbour."""
    height, width = light.shape[:2]
    marks = np.zeros((height, width), dtype=np.bool_)
    for row in range(height):
        for column in range(width):
            for down, right in ((0, 1), (1, 0)):
                i, j = row + down, column + right
                if i < height and j < width:
                    for c in range(3):
                        if abs(light[i, j, c] - light[row, column, c]) > contrast:
                            marks[row, column] = True
                            marks[i, j] = True
    return marks
