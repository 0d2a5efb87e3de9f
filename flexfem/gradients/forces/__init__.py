# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of the forces of joints at accepted states."""
