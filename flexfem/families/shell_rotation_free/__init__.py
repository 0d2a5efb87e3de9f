# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotation-free triangles: membranes and bending from nodal positions alone."""
