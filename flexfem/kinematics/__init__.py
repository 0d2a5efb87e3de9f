# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mechanisms whose bodies move as wholes: assembly of positions, inverse dynamics."""

from flexfem.installation import check_packages

check_packages()
