# SPDX-License-Identifier: LGPL-3.0-or-later
"""Declarations of probes: motion of markers, energies, forces, strains."""
