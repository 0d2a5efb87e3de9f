# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shapes of meshes as functions of numbers, and derivatives by the places of nodes."""
