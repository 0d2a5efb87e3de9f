# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compilation of users' functions."""
