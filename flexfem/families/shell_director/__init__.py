# SPDX-License-Identifier: LGPL-3.0-or-later
"""Director triangles: geometrically exact shells that shear, with quadratic positions."""
