# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parts of several families: section laws, corotating axes of nodes, nodes of shells and lines."""
