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


def shifted_sections() -> tuple[ff.Section, ff.Section, np.ndarray]:
    """One section with its axis through the mass centre, and beside it; the centre seen there.

    The offset is large: five times the radius of gyration.
    """
    mass, c = 1.3, np.array([0.0, 0.4, -0.3])
    rng = np.random.default_rng(8)
    root, arm = rng.normal(size=(6, 6)), so3.skew(c)
    D, rotary = root @ root.T + 6.0 * np.eye(6), mass * np.diag([0.01, 0.006, 0.005])
    centred = np.block([[mass * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), rotary]])
    # twists and strains at the centre from those of the axis: (a + b x c, b)
    X = np.block([[np.eye(3), -arm], [np.zeros((3, 3)), np.eye(3)]])
    return ff.Section.general(D, centred), ff.Section.general(X.T @ D @ X, X.T @ centred @ X), c
