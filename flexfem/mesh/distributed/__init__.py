# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes on ranks: partition of bodies, and each rank's part of those of beams and shells."""
