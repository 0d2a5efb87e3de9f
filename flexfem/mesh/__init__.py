# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of bodies: nodes, cells, named groups and the geometry derived from them."""
