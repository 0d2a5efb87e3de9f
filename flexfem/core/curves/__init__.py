# SPDX-License-Identifier: LGPL-3.0-or-later
"""Curves through given points, and tangents of circles."""
