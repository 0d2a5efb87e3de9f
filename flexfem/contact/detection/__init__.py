# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact detection: broad phase, neighbour lists, narrow phase, sides of triangles."""
