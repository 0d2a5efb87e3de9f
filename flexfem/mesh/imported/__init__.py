# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes in the files of other programs: one reader a format, one builder a kind of mesh."""
