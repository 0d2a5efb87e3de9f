# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elastic normal force of all contacts, whose stiffness grows with the penetration.

Impacts that last a step or two need a soft contact, in which a few heavily loaded nodes would
penetrate by more than the thickness. The slope of the force therefore grows from k at contact to
``m k``,

    F'(d) = k (1 + (m - 1) x^2 / (1 + x^2)),   x = d / (c r),

with the penetration d, the contact distance r and c = 0.1: half of the growth is reached at a tenth
of that distance. The force has a potential and a slope without jumps.
"""

import numpy as np

from flexfem.contact.law.data import FORCE, GAP, POTENTIAL, REACH, SLOPE, Found
from flexfem.kernels.compiled import kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["STIFFER", "stiffen"]

#: Largest slope over that at contact.
STIFFER = 10.0
#: Penetration over the contact distance at which half of the growth is reached.
_DEPTH = 0.1


@kernel
def stiffen(found: Memory, most: float) -> None:
    """Write force, slope and potential of contacts over k from their gaps, which are negative.

    ``most`` is m, at least 1; with 1 the force is the gap, without stiffening.
    """
    own = unpack(Found, found)
    contacts = own.numbers
    for c in range(own.closed[0]):
        contact = contacts[c]
        g, reach = contact[GAP], contact[REACH]
        contact[FORCE], contact[SLOPE], contact[POTENTIAL] = g, 1.0, 0.5 * g * g
        if most > 1.0 and reach > 0.0:
            d = _DEPTH * reach
            x = g / d
            turn, more = np.arctan(x), most - 1.0
            contact[FORCE] += more * (g - d * turn)
            contact[SLOPE] += more * x * x / (1.0 + x * x)
            contact[POTENTIAL] += more * d * d * (0.5 * x * x - x * turn + 0.5 * np.log1p(x * x))
