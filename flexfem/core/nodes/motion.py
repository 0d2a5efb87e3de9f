# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kinetic energy, momenta and mass of inertia at nodes; of a single one for compiled loops.

They are summed into one array ``motion`` (11,), all components inertial:

======  ==============================================================
0       kinetic energy, J
1       mass, kg
2:5     first moment of mass about the inertial origin, kg m
5:8     linear momentum, kg m/s
8:11    angular momentum about the inertial origin, kg m^2/s
======  ==============================================================
"""

import numpy as np
from scipy.sparse import csr_array

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined

__all__ = [
    "ANGULAR",
    "FIRST",
    "KINETIC",
    "LINEAR",
    "MASS",
    "WIDTH",
    "add_motion",
    "add_motion_of_points",
    "centre_into",
]

KINETIC, MASS, FIRST, LINEAR, ANGULAR, WIDTH = 0, 1, 2, 5, 8, 11


@inlined
def add_motion(
    H: FloatArray, v: FloatArray, M: FloatArray, scale: float, p: FloatArray, motion: FloatArray
) -> None:
    """Add ``scale`` times the contribution of an inertia matrix fixed to a frame.

    Args:
        H: (12,) frame.
        v: (6,) its local twist.
        M: (6, 6) inertia about the frame's origin in its axes, ``[[m I, -S], [S, J]]``.
        scale: factor.
        p: (6,) work space.
        motion: (11,) see above.
    """
    for i in range(6):
        p[i] = 0.0
        for j in range(6):
            p[i] += scale * M[i, j] * v[j]
    for i in range(6):
        motion[KINETIC] += 0.5 * v[i] * p[i]
    motion[MASS] += scale * M[0, 0]
    for i in range(3):
        k, i1, i2 = 3 + 3 * i, (i + 1) % 3, (i + 2) % 3
        # S = skew(first moment about the frame's origin)
        first = H[k] * M[5, 1] + H[k + 1] * M[3, 2] + H[k + 2] * M[4, 0]
        motion[FIRST + i] += scale * (M[0, 0] * H[i] + first)
        force = H[k] * p[0] + H[k + 1] * p[1] + H[k + 2] * p[2]
        motion[LINEAR + i] += force
        motion[ANGULAR + i] += H[k] * p[3] + H[k + 1] * p[4] + H[k + 2] * p[5]
        # its part of x cross momentum
        motion[ANGULAR + i1] += H[i2] * force
        motion[ANGULAR + i2] -= H[i1] * force


@inlined
def centre_into(H: FloatArray, v: FloatArray, M: FloatArray, x: FloatArray, u: FloatArray) -> None:
    """Write position and velocity (3,) of the mass centre, inertial axes; see :func:`add_motion`.

    Without mass they are those of the frame.
    """
    per = 1.0 / M[0, 0] if M[0, 0] > 0.0 else 0.0
    c0, c1, c2 = per * M[5, 1], per * M[3, 2], per * M[4, 0]
    u0 = v[0] + v[4] * c2 - v[5] * c1
    u1 = v[1] + v[5] * c0 - v[3] * c2
    u2 = v[2] + v[3] * c1 - v[4] * c0
    for i in range(3):
        k = 3 + 3 * i
        x[i] = H[i] + H[k] * c0 + H[k + 1] * c1 + H[k + 2] * c2
        u[i] = H[k] * u0 + H[k + 1] * u1 + H[k + 2] * u2


def add_motion_of_points(mass: csr_array, x: FloatArray, v: FloatArray, motion: FloatArray) -> None:
    """Add the contribution of points with a mass matrix.

    Args:
        mass: (n, n) of one direction, kg.
        x: (n, 3) positions, m.
        v: (n, 3) velocities, m/s.
        motion: (11,) see above.
    """
    momenta = mass @ v
    motion[KINETIC] += 0.5 * float((momenta * v).sum())
    motion[MASS] += float(mass.sum())
    motion[FIRST:LINEAR] += (mass @ x).sum(axis=0)
    motion[LINEAR:ANGULAR] += momenta.sum(axis=0)
    motion[ANGULAR:WIDTH] += np.cross(x, momenta).sum(axis=0)
