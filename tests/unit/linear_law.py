# SPDX-License-Identifier: LGPL-3.0-or-later
"""The linear law of any stiffness matrix and damping, written as a user would: compiled once."""

import numpy as np

import flexfem as ff


def _name(i: int, j: int) -> str:
    return f"d{i}{j}"


def _quadratic(values, p):
    return sum(
        getattr(p, _name(i, j)) * values[i] * values[j] * (0.5 if i == j else 1.0)
        for i in range(6)
        for j in range(i, 6)
    )


def linear_law(stiffness: np.ndarray, damping: float) -> ff.BeamLaw:
    """That of a stiffness matrix (6, 6) and stiffness-proportional damping (s)."""
    return ff.BeamLaw(
        _quadratic,
        dissipation=lambda strain, rate, p: p.damping * _quadratic(rate, p),
        parameters={_name(i, j): stiffness[i, j] for i in range(6) for j in range(i, 6)}
        | {"damping": damping},
    )
