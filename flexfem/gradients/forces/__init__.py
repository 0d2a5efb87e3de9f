# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of forces of joints, energies and momenta at accepted states."""
