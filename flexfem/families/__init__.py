# SPDX-License-Identifier: LGPL-3.0-or-later
"""Families of bodies, a folder each: layout, elements, loads and measures of one kind of body.

The contract is ``flexfem.layout.family.Family``; ``family`` in each folder keeps it, ``elements``
has the elements of a rank. Common parts of several families are in ``common``.
"""
