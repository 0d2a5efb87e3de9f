# SPDX-License-Identifier: LGPL-3.0-or-later
"""Number of cells that one call of a batched kernel treats."""

__all__ = ["LANES"]

#: Cells of one call: the width of the largest vectors of today's processors.
LANES = 8
