# SPDX-License-Identifier: LGPL-3.0-or-later
"""What needs a mesh: linear elastic bodies as forms, and their reduction."""

from flexfem.installation import load_dolfinx

load_dolfinx()
