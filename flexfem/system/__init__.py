# SPDX-License-Identifier: LGPL-3.0-or-later
"""The system on the ranks: blocks, residuals and matrices.

``build`` makes it of a model, ``measure`` holds energies, momenta and probes.
"""
