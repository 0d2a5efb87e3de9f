# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs of equations of motion: from a source of equations to results in a folder."""

from flexfem.installation import load_dolfinx

load_dolfinx()
