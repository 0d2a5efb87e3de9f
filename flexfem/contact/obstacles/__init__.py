# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces of contact: triangles of bodies, and rigid surfaces of simple shapes."""
