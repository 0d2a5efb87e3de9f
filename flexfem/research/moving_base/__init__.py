# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cantilever beam on a moving base by assumed modes: with and without dynamic stiffening."""
