# SPDX-License-Identifier: LGPL-3.0-or-later
"""Array types used throughout the package."""

import numpy as np
import numpy.typing as npt

#: Array of 64-bit floating-point numbers.
FloatArray = npt.NDArray[np.float64]
#: Array of 64-bit integers (node and cell indices).
IntArray = npt.NDArray[np.int64]
