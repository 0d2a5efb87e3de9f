# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid-body kinematics of mechanisms: assembly of positions, inverse dynamics."""

from flexfem.installation import check_packages

check_packages()
