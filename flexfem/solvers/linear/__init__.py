# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear systems of a step: exact tangent, compiled factors, multipliers shared by ranks, GMRES."""
