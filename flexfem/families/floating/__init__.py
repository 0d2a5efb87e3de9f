# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reduced elastic bodies in floating frames, each of them one element."""
