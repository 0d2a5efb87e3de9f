# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stresses of a law from the derivatives of its energy at rest, as reduced bodies have them."""

import numpy as np

from flexfem._types import FloatArray

__all__ = ["COUNT", "VOIGT", "cauchy_stress", "moduli"]

_ORDERS = (2, 3, 4)
#: Number of derivatives of second to fourth order.
COUNT = sum(9**order for order in _ORDERS)
#: Components of a stress in pictures: xx, yy, zz, yz, xz, xy.
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


def moduli(derivatives: tuple[FloatArray, FloatArray, FloatArray]) -> FloatArray:
    """Derivatives of second to fourth order by the rows of F as one array (COUNT,)."""
    return np.concatenate([tensor.ravel() for tensor in derivatives])


def cauchy_stress(law: FloatArray, gradients: FloatArray) -> FloatArray:
    """Cauchy stresses (t, 6) xx, yy, zz, yz, xz, xy, Pa.

    ``sigma = P F^T / det F`` with the first Piola-Kirchhoff stress P to third order in H, exact for
    Saint Venant and Kirchhoff's law.

    Args:
        law: (COUNT,) see :func:`moduli`, Pa.
        gradients: (t, 9) rows of the displacement gradients H, ``F = I + H``.
    """
    ends = np.cumsum([9**order for order in _ORDERS])[:-1]
    second, third, fourth = (
        part.reshape((9,) * order) for part, order in zip(np.split(law, ends), _ORDERS, strict=True)
    )
    H = gradients
    pairs = np.einsum("ti,tj->tij", H, H).reshape(len(H), -1)
    piola = H @ second + pairs @ third.reshape(81, 9) / 2.0
    piola += np.einsum("ti,tj,ija->ta", pairs, H, fourth.reshape(81, 9, 9), optimize=True) / 6.0
    F = np.eye(3) + H.reshape(-1, 3, 3)
    sizes = np.linalg.det(F)[:, np.newaxis, np.newaxis]
    stress = np.einsum("tab,tcb->tac", piola.reshape(-1, 3, 3), F) / sizes
    voigt: FloatArray = np.stack([stress[:, i, j] for i, j in VOIGT], axis=1)
    return voigt
