# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over cells for stress resultants and values of laws at given strains."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.la.kernel import tabulate
from flexfem.lie.compiled import kernel

__all__ = ["law_values", "linear_resultants"]


@kernel
def linear_resultants(
    strain: FloatArray, sections: IntArray, stiffness: FloatArray, resultant: FloatArray
) -> None:
    """Resultants (m, 6) of all cells from their strains by the stiffness (s, 6, 6)."""
    for c in range(sections.size):
        D = stiffness[sections[c]]
        for i in range(6):
            resultant[c, i] = 0.0
            for j in range(6):
                resultant[c, i] += D[i, j] * strain[c, j]


@kernel
def law_values(
    address: int, offsets: IntArray, strain: FloatArray, rate: FloatArray, sections: IntArray,
    parameters: FloatArray, values: FloatArray,
) -> None:  # fmt: skip
    """Write what ``forms.beam_law.LawForm`` lists to ``values`` (m, k).

    ``parameters`` (s, p) are those of each section.
    """
    data, nothing, points = np.zeros(offsets[-1]), np.zeros(1), np.zeros(6)
    points[3] = 1.0
    for c in range(sections.size):
        if offsets[0] >= 0:
            for i in range(6):
                data[offsets[0] + i] = strain[c, i]
        if offsets[1] >= 0:
            for i in range(6):
                data[offsets[1] + i] = rate[c, i]
        if offsets.size > 3 and offsets[2] >= 0:
            for i in range(parameters.shape[1]):
                data[offsets[2] + i] = parameters[sections[c], i]
        values[c] = 0.0
        tabulate(address, values[c], data, nothing, points)
