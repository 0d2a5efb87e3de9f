# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loop over cells for stress resultants at given strains."""

from flexfem._types import FloatArray, IntArray
from flexfem.kernels.compiled import kernel

__all__ = ["linear_resultants"]


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
