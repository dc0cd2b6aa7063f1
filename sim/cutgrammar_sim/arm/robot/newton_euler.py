"""The compiled core of the dynamics: the recursive Newton-Euler equations of a serial chain, over plain arrays."""

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats, Ints


@njit(cache=True)
def cross(a: Floats, b: Floats, out: Floats) -> None:
    """Fill out (3,) with a x b."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def turned(R: Floats, v: Floats, out: Floats) -> None:
    """Fill out (3,) with R v."""
    for a in range(3):
        out[a] = R[a, 0] * v[0] + R[a, 1] * v[1] + R[a, 2] * v[2]


@njit(cache=True)
def torques_for(
    poses: Floats,
    axes: Floats,
    qd: Floats,
    qdd: Floats,
    link: Ints,
    mass: Floats,
    p_LC: Floats,
    inertia: Floats,
    gravity: float,
) -> Floats:
    """(t, n) torques of the motors [N m].

    Args:
        poses: (t, n + 1, 4, 4) X_AL of the links.
        axes: (n, 3) of joint i in the frame of link i + 1.
        qd, qdd: (t, n) [rad/s, rad/s2].
        link: (k,) which link each of k bodies is fixed to, ascending, none to the first.
        mass, p_LC, inertia: (k,), (k, 3), (k, 3, 3) of the bodies, in their links [kg, m, kg m2].
        gravity: down along z of A [m/s2].
    """
    t, n = qd.shape
    tau = np.empty((t, n))
    forces, torques = np.empty((n, 3)), np.empty((n, 3))  # that each link needs, about its origin
    axis, r, spin, c, force = np.empty((n, 3)), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    one, two, local, turn = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(t):
        # outward: velocities and accelerations of every link's origin, which falls upwards in place of gravity
        w, dw, a = np.zeros(3), np.zeros(3), np.zeros(3)
        a[2] = gravity
        forces[:] = 0.0
        torques[:] = 0.0
        body = 0
        for i in range(n):
            R = poses[k, i + 1, :3, :3]
            turned(R, axes[i], axis[i])
            r[:] = poses[k, i + 1, :3, 3] - poses[k, i, :3, 3]
            cross(dw, r, one)
            a += one
            cross(w, r, one)
            cross(w, one, two)
            a += two
            spin[:] = axis[i] * qd[k, i]
            cross(w, spin, one)
            dw += axis[i] * qdd[k, i] + one
            w += spin
            while body < link.size and link[body] == i + 1:
                turned(R, p_LC[body], c)
                cross(dw, c, one)
                force[:] = a + one
                cross(w, c, one)
                cross(w, one, two)
                force += two
                force *= mass[body]
                forces[i] += force
                cross(c, force, one)
                torques[i] += one
                for v in range(2):  # of the angular acceleration and of the angular velocity, in the link's axes
                    of = dw if v == 0 else w
                    for b in range(3):
                        local[b] = R[0, b] * of[0] + R[1, b] * of[1] + R[2, b] * of[2]
                    turned(inertia[body], local, turn)
                    turned(R, turn, one)
                    if v == 0:
                        torques[i] += one
                    else:
                        cross(w, one, two)
                        torques[i] += two
                body += 1
        # inward: what each joint hands on
        force[:] = 0.0
        spin[:] = 0.0  # from here on the torque
        for i in range(n - 1, -1, -1):
            if i + 1 < n:
                r[:] = poses[k, i + 2, :3, 3] - poses[k, i + 1, :3, 3]
                cross(r, force, one)
                spin += one
            force += forces[i]
            spin += torques[i]
            tau[k, i] = axis[i, 0] * spin[0] + axis[i, 1] * spin[1] + axis[i, 2] * spin[2]
    return tau
