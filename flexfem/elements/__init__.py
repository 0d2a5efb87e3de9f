# SPDX-License-Identifier: LGPL-3.0-or-later
"""Flexible elements: one formulation a file."""
