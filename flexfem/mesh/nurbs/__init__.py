# SPDX-License-Identifier: LGPL-3.0-or-later
"""NURBS curves: bases, elements, frames, fits and refinement."""
