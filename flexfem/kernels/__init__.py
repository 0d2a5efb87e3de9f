# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled code: loops by numba, cell kernels by FFCx, and the caches of both.

``compiled`` has the decorators of all loops, ``records`` the records that they take as one
argument, ``driver`` the loops over cells around kernels that FFCx makes of UFL forms (``ffcx``).
"""
