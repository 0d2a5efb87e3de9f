# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of points with triangles and with rigid surfaces, by penalties.

``points`` and ``pairs`` are the same on every rank, ``contacts`` are those of a rank; ``detection``
finds the contacts, ``law`` computes the forces, ``obstacles`` are the surfaces of contact.
"""
