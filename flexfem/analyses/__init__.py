# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kinds of analysis of cases: one a file, with its options."""
