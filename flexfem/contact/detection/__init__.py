# SPDX-License-Identifier: LGPL-3.0-or-later
"""What touches what: broad phase, neighbour lists, narrow phase, sides of triangles."""
