# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear algebra on PETSc: nests of blocks, kept factors, small matrices whole on every rank."""
