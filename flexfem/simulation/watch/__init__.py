# SPDX-License-Identifier: LGPL-3.0-or-later
"""Monitors of a run: spurious energy, invalid states, locking, unresolved rotations."""
