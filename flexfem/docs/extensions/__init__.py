# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the pages need of Sphinx: formulas without network, and texts made from the package."""
