# SPDX-License-Identifier: LGPL-3.0-or-later
"""Array types used throughout the package."""

import numpy as np
import numpy.typing as npt

#: Array of 64-bit floating-point numbers.
FloatArray = npt.NDArray[np.float64]
#: Array of 64-bit integers (node and cell indices).
IntArray = npt.NDArray[np.int64]
#: Array of integers of any size (cells of a DOLFINx mesh hold 32-bit ones).
IndexArray = npt.NDArray[np.integer]
#: Array of truth values.
BoolArray = npt.NDArray[np.bool_]
