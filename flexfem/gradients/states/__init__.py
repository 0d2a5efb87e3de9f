# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of equilibria, frequencies, responses and buckling loads, and what is common."""
