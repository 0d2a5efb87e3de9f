# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kinds of analysis a case can ask for: one a file, with its options."""
