# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of primitives: pairs of vertices, edges and triangles on arrays of points.

``complexes`` weighs the cells of surfaces and polylines, ``search`` finds candidates for pairs,
leaving out ``neighbourhoods``, and ``ccd`` the largest step without contact. ``forces`` evaluates
the potential of ``barrier`` at the ``closest`` points, ``tangents`` its linearisation. Nothing here
knows of bodies.
"""
