# SPDX-License-Identifier: LGPL-3.0-or-later
"""The numbered model, and the interface of the system to every family of bodies.

Nodes, markers and places have the same numbers on every rank in ``numbered_model``; ``placement``
distributes them. ``family`` is the contract of families of bodies, ``elements`` that of their
elements on a rank; ``node_loads``, ``line_loads`` and ``inner_forces`` are the forces that act on
them.
"""
