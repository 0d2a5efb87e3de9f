# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lines along which the forces of a pair over a step do exactly the work of its potential.

With the weights w0 and w1 of the closest points before and after a step, those between are
w(a) = (1 - a) w0 + a w1. At the middle positions x of the step dx, r = sum w_i(a) x_i, and

    2 r . sum w_i(a) dx_i = D1^2 - D0^2

for one a: on the left is the change of the squared distance of points with fixed weights, which
for w0 is not less than the right-hand side, since D1 is the least distance after the step, and for
w1 not more, since D0 is the least before. A force along r on these points hence does exactly the
work -(b(D1) - b(D0)) if its factor is the difference quotient of the potential by D^2 / 2. It has
no torque about the middle positions, and no sum. There is no case in which a divisor vanishes,
unlike with the closest points of the middle positions.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined

__all__ = ["mean_line"]


@inlined
def _part(start: float, end: float, bend: float) -> float:
    """Root in [0, 1] of a parabola that is not negative at 0 and not positive at 1.

    Args:
        start: its value at 0.
        end: its value at 1.
        bend: its coefficient of a^2.
    """
    linear = end - start - bend
    root = np.sqrt(max(linear * linear - 4.0 * bend * start, 0.0))
    if linear > 0.0:  # then bend is negative
        above, below = linear + root, -2.0 * bend
    else:
        above, below = 2.0 * start, root - linear
    if below <= 0.0 or above <= 0.0:
        return 0.5
    return float(min(above / below, 1.0))


@inlined
def mean_line(
    x: FloatArray, dx: FloatArray, w0: FloatArray, w1: FloatArray, change: float, w: FloatArray,
    r: FloatArray,
) -> float:  # fmt: skip
    """Write the weights w (4,) and the vector r (3,) of a step.

    Args:
        x: middle positions (4, 3) of the points, m.
        dx: their step.
        w0: weights (4,) of the closest points before the step.
        w1: those after it.
        change: D1^2 - D0^2, m^2.
        w: written weights.
        r: written vector.

    Returns:
        How far the closest points move along both primitives, at the middle positions, m.
    """
    start, end, bend, slid = -change, -change, 0.0, 0.0
    for a in range(3):
        m0 = m1 = e0 = e1 = 0.0
        for i in range(4):
            m0 += w0[i] * x[i, a]
            m1 += w1[i] * x[i, a]
            e0 += w0[i] * dx[i, a]
            e1 += w1[i] * dx[i, a]
        start += 2.0 * m0 * e0
        end += 2.0 * m1 * e1
        bend += 2.0 * (m1 - m0) * (e1 - e0)
        slid += (m1 - m0) ** 2
    part = _part(start, end, bend)
    for i in range(4):
        w[i] = w0[i] + part * (w1[i] - w0[i])
    for a in range(3):
        r[a] = w[0] * x[0, a] + w[1] * x[1, a] + w[2] * x[2, a] + w[3] * x[3, a]
    return float(np.sqrt(slid))
