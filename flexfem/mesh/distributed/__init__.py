# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes on ranks: partition of bodies, and DOLFINx meshes of beams and shells."""
