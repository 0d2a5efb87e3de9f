# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sections of test beams."""

import numpy as np

import flexfem as ff
from flexfem.lie import so3


def coupled_section() -> ff.Section:
    """Every entry of the stiffness couples; the mass centre lies off the axis."""
    rng = np.random.default_rng(7)
    root, j = rng.normal(size=(6, 6)), rng.normal(size=(3, 3))
    first = 1.3 * so3.skew(np.array([0.0, 0.11, -0.07]))
    rotary = 0.1 * (j @ j.T + np.eye(3)) - first @ first / 1.3
    inertia = np.block([[1.3 * np.eye(3), -first], [first, rotary]])
    return ff.Section.general(root @ root.T + 6.0 * np.eye(6), inertia)
