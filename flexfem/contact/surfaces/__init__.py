# SPDX-License-Identifier: LGPL-3.0-or-later
"""Collision surfaces of a model: which bodies touch, their points, edges, triangles and weights."""
