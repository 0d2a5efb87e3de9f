# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows of joints with markers on lines between nodes, or that slide on them."""
