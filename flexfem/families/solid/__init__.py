# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear solids: bodies of finite elements with any material law in UFL, large strains."""
