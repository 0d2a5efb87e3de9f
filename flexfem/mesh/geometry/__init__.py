# SPDX-License-Identifier: LGPL-3.0-or-later
"""Order of nodes along lines, tangents, normals and section frames."""
