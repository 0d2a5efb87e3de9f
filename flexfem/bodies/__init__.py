# SPDX-License-Identifier: LGPL-3.0-or-later
"""Inertia and forces concentrated at nodes: rigid bodies, point masses, point and line loads."""
