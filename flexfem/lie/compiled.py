# SPDX-License-Identifier: LGPL-3.0-or-later
"""How all compiled loops of the package are compiled."""

from numba import njit

from flexfem.lie.caching import install

__all__ = ["fused", "inlined", "inlined_fused", "kernel"]

install()

#: cached on disk; division by zero gives inf or NaN as in NumPy, and no test in the loop
kernel = njit(cache=True, error_model="numpy")

#: For pieces of a loop's body: inlined by force, since a call with array arguments costs more than
#: the arithmetic of most of them.
inlined = njit(cache=True, error_model="numpy", forceinline=True)

#: The same with products and sums fused to one operation each, for loops of arithmetic alone.
fused = njit(cache=True, error_model="numpy", fastmath={"contract"})

#: Pieces of those.
inlined_fused = njit(cache=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
