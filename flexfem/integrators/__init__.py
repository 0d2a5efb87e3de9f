# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time integrators, one scheme a file; consistent starts, rates of drives, redundancy."""
