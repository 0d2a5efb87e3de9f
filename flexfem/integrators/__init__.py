# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time integrators: one scheme a file, each a frozen set of coefficients."""
