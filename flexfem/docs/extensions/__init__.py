# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sphinx extensions of these pages: formulas without network, texts made from the package."""
