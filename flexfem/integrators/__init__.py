# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time integrators, one scheme a file, and what they share: starts, rates of drives, redundancy."""
