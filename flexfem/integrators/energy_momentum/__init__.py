# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energy-momentum method: scheme, equations of a step, discrete gradients of rows."""
