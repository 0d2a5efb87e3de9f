# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static equilibria: at given loads, along paths, over limit points; stability and buckling."""
