# SPDX-License-Identifier: LGPL-3.0-or-later
"""Geometrically exact beams along NURBS curves."""
