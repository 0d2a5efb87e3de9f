# SPDX-License-Identifier: LGPL-3.0-or-later
"""Watches over a motion: spurious energy, inverted bodies, locking, unresolved rotations."""
