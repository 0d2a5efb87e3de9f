# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linearised equations of a step, forwards and transposed, and the maps of its nodes."""
