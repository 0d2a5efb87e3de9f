# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces that points touch: triangles of bodies, and rigid surfaces of simple shapes."""
