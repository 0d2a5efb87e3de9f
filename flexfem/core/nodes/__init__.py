# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes with a frame each: prediction, correction and acceptance of steps, sums over them.

Nodes of other ranks come by ``halo``.
"""
