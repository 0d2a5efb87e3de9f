# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions that are differentiated: their states, the adjoint backwards and the tangent forwards."""
