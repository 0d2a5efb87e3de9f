# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of whole motions: the discrete adjoint of the time integrator, and its tangent."""
