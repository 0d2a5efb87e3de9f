# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of points with obstacles given by their signed distance.

``shapes`` has the closest points of simple obstacles, ``flexfem.kernels.users.signed_distance``
those of users' functions; ``obstacles`` has them in their places. ``search`` finds pairs, ``steps``
and ``statics`` evaluate the barrier's forces, ``tangents`` linearises them, and ``ccd`` has the
largest step without contact. Records, sums and laws are those of pairs of cells
(``contact.primitives``, ``contact.dissipation``).
"""
