# SPDX-License-Identifier: LGPL-3.0-or-later
"""Declarations of loads and their amplitudes."""
