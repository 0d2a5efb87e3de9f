# SPDX-License-Identifier: LGPL-3.0-or-later
"""Monitors of a motion: spurious energy, inverted bodies, locking, unresolved rotations."""
