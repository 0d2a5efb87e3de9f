# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotations and frames: the groups SO(3) and SE(3) as NumPy functions and compiled kernels."""
