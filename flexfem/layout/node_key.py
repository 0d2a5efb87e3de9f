# SPDX-License-Identifier: LGPL-3.0-or-later
"""Keys of nodes that are the same on every rank."""

__all__ = ["NodeKey"]

#: Number of a family and of a node in it.
NodeKey = tuple[int, int]
