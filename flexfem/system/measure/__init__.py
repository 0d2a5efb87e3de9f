# SPDX-License-Identifier: LGPL-3.0-or-later
"""Measures of a system: energies, momenta, motion of markers, probes and their rates."""
