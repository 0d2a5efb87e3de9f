# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of solids, in memory or stored and read by parts, and figures: cells with their nodes."""
