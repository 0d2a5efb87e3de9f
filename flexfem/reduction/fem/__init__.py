# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear elastic bodies on meshes: their forms and their model order reduction."""

from flexfem.installation import load_dolfinx

load_dolfinx()
