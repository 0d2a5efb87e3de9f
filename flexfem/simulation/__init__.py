# SPDX-License-Identifier: LGPL-3.0-or-later
"""Drivers: from a model and settings to results in a folder, one kind of analysis a file."""

from contextlib import suppress

with suppress(ImportError):  # absent beside a DOLFINx of conda, Debian or a container
    import dolfinx_solver  # noqa: F401  (the binary wheel must come before dolfinx and petsc4py)
