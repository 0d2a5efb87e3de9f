# SPDX-License-Identifier: LGPL-3.0-or-later
"""CSV tables: histories, materials and sections, words and numbers."""
