# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies and point masses: one node each, no elements."""
