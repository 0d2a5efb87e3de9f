# SPDX-License-Identifier: LGPL-3.0-or-later
"""Families of bodies, one a module: layout, distribution, elements, loads and measures of a kind.

The contract is ``flexfem.system.family.Family``.
"""
