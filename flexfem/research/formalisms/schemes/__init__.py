# SPDX-License-Identifier: LGPL-3.0-or-later
"""Integration schemes of their own of Maggi's and Hamilton's equations."""
