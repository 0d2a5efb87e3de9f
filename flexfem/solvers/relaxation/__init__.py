# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dynamic relaxation: equilibria as the end of a damped motion in fictitious time."""
