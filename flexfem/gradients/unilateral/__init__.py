# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of contacts and of other unilateral forces, which act over a step."""
