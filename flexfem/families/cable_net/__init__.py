# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nets of cables that are slack in compression, and trusses of bars."""
