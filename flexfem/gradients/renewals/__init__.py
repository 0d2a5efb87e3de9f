# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of states whose velocities and accelerations are made consistent."""
