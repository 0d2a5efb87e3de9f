# SPDX-License-Identifier: LGPL-3.0-or-later
"""Director triangles: geometrically exact shells with shear strain and quadratic positions."""
