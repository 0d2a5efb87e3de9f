# SPDX-License-Identifier: LGPL-3.0-or-later
"""A normal force that grows faster than the penetration.

Impacts that last a step or two need a soft contact, which few nodes that carry much load sink into
by more than the thickness. So the slope of the force grows from k at contact to ``m k``,

    F'(d) = k (1 + (m - 1) x^2 / (1 + x^2)),   x = d / (c r),

d the penetration, r the distance at which the surfaces touch, c = 0.1: it is half way up at a tenth
of that distance. The force has a potential and a slope without jumps.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.lie.compiled import kernel

__all__ = ["STIFFER", "stiffen"]

#: Largest slope over that at contact.
STIFFER = 10.0
#: Penetration over the distance of touching at which the slope is half way up.
_DEPTH = 0.1


@kernel
def stiffen(
    count: int, contacts: FloatArray, gap: int, first: int, slaves: IntArray, offsets: FloatArray,
    triangles: IntArray, thickness: FloatArray, most: float,
) -> None:  # fmt: skip
    """Write force, slope and potential of contacts (c, ...), over k, from column ``first`` on.

    Args:
        count: Number of contacts.
        contacts: Their numbers; gaps, negative, in the column ``gap``, m.
        gap: Column of the gaps: 3 of triangles (``find.FIELDS``), 0 of ``rigid.RIGID_FIELDS``.
        first: Column of the force, 22 or 15; slope and potential follow it.
        slaves: Of each, shape (c,).
        offsets: Distance at which slaves touch a surface without thickness, shape (s,), metres.
        triangles: Of each contact, shape (c,); none for rigid surfaces.
        thickness: Half of the thickness of triangles, shape (m,), metres.
        most: m, at least 1.
    """
    for c in range(count):
        g = contacts[c, gap]
        reach = offsets[slaves[c]] + (thickness[triangles[c]] if triangles.size else 0.0)
        contacts[c, first], contacts[c, first + 1], contacts[c, first + 2] = g, 1.0, 0.5 * g * g
        if most > 1.0 and reach > 0.0:
            d = _DEPTH * reach
            x = g / d
            turn, more = np.arctan(x), most - 1.0
            contacts[c, first] += more * (g - d * turn)
            contacts[c, first + 1] += more * x * x / (1.0 + x * x)
            contacts[c, first + 2] += (
                more * d * d * (0.5 * x * x - x * turn + 0.5 * np.log1p(x * x))
            )
