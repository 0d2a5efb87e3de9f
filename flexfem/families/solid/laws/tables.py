# SPDX-License-Identifier: LGPL-3.0-or-later
"""Laws from tables: splines through measured values, in expressions of UFL."""

from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks

__all__ = ["spline"]

#: Largest number of knots: each adds a term to the energy and to its derivatives.
_MOST = 40


def spline(x: Any, knots: npt.ArrayLike, values: npt.ArrayLike) -> Any:
    """Natural cubic spline of an expression, for energies from tables.

    It goes through the values, has two continuous derivatives, and goes on along straight lines
    beyond the first and the last knot. An energy of the first invariant, say, is
    ``ff.laws.spline(ufl.tr(C) - 3, knots, values)`` in the function of a :class:`Hyperelastic`::

        W(x) = a + b x + sum_k c_k max(x - x_k, 0)^3,  sum_k c_k = sum_k c_k x_k = 0

    (de Boor, A Practical Guide to Splines, 2001, chapter IV). Energies must be convex enough for
    the body to have a stiffness; that is checked with the body.

    Args:
        x: scalar expression of UFL, or a number.
        knots: (k,) increasing arguments, at least three and at most 40.
        values: (k,) values at the knots.

    Returns:
        The expression, or a number.

    Raises:
        ValueError: the numbers are not of this form.
    """
    import ufl
    from scipy.interpolate import CubicSpline

    at = _checks.array("spline", "knots", knots, (-1,))
    through = _checks.array("spline", "values", values, (-1,))
    if not 3 <= len(at) <= _MOST or (np.diff(at) <= 0.0).any():
        raise ValueError(
            f"spline: knots must be 3 to {_MOST} increasing numbers, got "
            f"{_checks.show(at.tolist())}"
        )
    if len(through) != len(at):
        raise ValueError(f"spline: values must be {len(at)} numbers, got {len(through)}")
    found = CubicSpline(at, through, bc_type="natural")
    # jumps of the third derivative, the curve being straight beyond both ends
    thirds = np.concatenate([[0.0], 6.0 * found.c[0], [0.0]])
    jumps = np.diff(thirds) / 6.0
    total = through[0] + float(found(at[0], 1)) * (x - at[0])
    for knot, jump in zip(at.tolist(), jumps.tolist(), strict=True):
        beyond = x - knot
        if isinstance(x, (int, float)):
            total += jump * max(beyond, 0.0) ** 3
        else:
            total += jump * ufl.conditional(ufl.gt(beyond, 0.0), beyond**3, 0.0)
    return total
