# SPDX-License-Identifier: LGPL-3.0-or-later
"""Triangles of surface meshes: topology, grids and checks."""
