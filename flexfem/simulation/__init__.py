# SPDX-License-Identifier: LGPL-3.0-or-later
"""Drivers: from a model and settings to results in a folder, one kind of analysis a file."""

from flexfem.installation import load_dolfinx

load_dolfinx()
