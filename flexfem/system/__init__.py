# SPDX-License-Identifier: LGPL-3.0-or-later
"""The system on the ranks: blocks, residuals and matrices.

``build`` creates it from a model, ``measure`` has energies, momenta and probes.
"""
