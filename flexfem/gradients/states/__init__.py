# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of equilibria, natural frequencies and buckling loads, and the function for all."""
