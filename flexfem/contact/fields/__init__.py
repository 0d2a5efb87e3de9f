# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of points with obstacles given by their signed distance.

``shapes`` has the closest points of simple obstacles, ``flexfem.kernels.users.signed_distance``
those of users' functions; ``obstacles`` places them on the ground and on nodes. ``search`` finds
pairs and what overlaps, ``steps`` and ``statics`` evaluate the barrier's forces, ``tangents`` sums
and linearises them, and ``ccd`` has the largest step without contact. All of it is independent of
the pairs of ``contact.primitives``, whose barrier and mean lines it uses.
"""
