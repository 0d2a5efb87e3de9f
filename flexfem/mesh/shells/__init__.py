# SPDX-License-Identifier: LGPL-3.0-or-later
"""Geometry of shells on triangles: normals, nodes with directors, curvatures of patches."""
