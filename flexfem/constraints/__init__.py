# SPDX-License-Identifier: LGPL-3.0-or-later
"""Constraints and force laws of joints: from the joints of a model to one batch of rows on a rank.

``connect`` places joints on nodes and lines, ``batch`` evaluates all their rows; ``terms`` has the
elementary functions, ``rows`` the loops over joints on nodes, ``lines`` those over joints on lines.
"""
