# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled user-defined functions of a relative pose, as terms: gradients and Hessians.

Their values and derivatives along local twists of b are those of
``constraints.terms.compiled_functions``.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.constraints.terms.compiled_functions import call
from flexfem.constraints.terms.relative import gradient_of_both, hessian_of_both, relative_pose
from flexfem.kernels.compiled import on_demand, subroutine

__all__ = ["evaluate_function", "function_hessian"]


@subroutine
def evaluate_function(
    address: int, Ha: FloatArray, Hb: FloatArray, d: FloatArray, g: FloatArray
) -> float:
    """Value of a function; its gradient in ``g`` (12), see ``constraints.rows.kernels.term``."""
    x, out = np.empty(13), np.empty(43)
    relative_pose(Ha, Hb, 1, x)
    call(address, x, d, out)
    gradient_of_both(x, out[1:7], g)
    value: float = out[0]
    return value


@on_demand
def function_hessian(
    address: int, Ha: FloatArray, Hb: FloatArray, d: FloatArray, h: FloatArray
) -> None:
    """Derivative (12, 12) of the gradient of a function.

    See ``constraints.rows.hessians.term_hessian``.
    """
    x, out = np.empty(13), np.empty(43)
    relative_pose(Ha, Hb, 2, x)
    call(address, x, d, out)
    hessian_of_both(x, out[1:7], out[7:], h)
