# SPDX-License-Identifier: LGPL-3.0-or-later
"""How all compiled loops of the package are compiled."""

from numba import njit

__all__ = ["kernel"]

#: cached on disk; division by zero gives inf or NaN as in NumPy, and no test in the loop
kernel = njit(cache=True, error_model="numpy")
