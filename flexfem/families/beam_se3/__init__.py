# SPDX-License-Identifier: LGPL-3.0-or-later
"""Geometrically exact beams of two-node elements that interpolate on SE(3)."""
