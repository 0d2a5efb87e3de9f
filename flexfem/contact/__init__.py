# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of nodes with triangles and with rigid surfaces, by penalties."""
