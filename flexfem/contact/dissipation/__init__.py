# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dissipation in contact over a step: restitution, damping and friction.

``steps`` evaluates the laws after ``primitives.steps``, for all ``groups`` of pairs: ``normal``
multiplies their forces, ``friction`` adds forces and couples across them, ``bridges`` help Newton's
method with both. ``rows`` applies the result, ``tilts`` gives the spins of points of shells whose
nodes have no rotations.
"""
