# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linearised equations of motion, their eigenmodes and reduced equations."""
