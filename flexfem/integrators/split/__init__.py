# SPDX-License-Identifier: LGPL-3.0-or-later
"""Unilateral forces as impulses, split from the smooth part of a time integrator."""
