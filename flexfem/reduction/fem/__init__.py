# SPDX-License-Identifier: LGPL-3.0-or-later
"""What needs a mesh: linear elastic bodies as forms, and their reduction."""

from contextlib import suppress

with suppress(ImportError):  # absent beside a DOLFINx of conda, Debian or a container
    import dolfinx_solver  # noqa: F401  (the binary wheel must come before dolfinx and petsc4py)
