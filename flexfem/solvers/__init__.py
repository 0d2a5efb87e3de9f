# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton iteration and its linear solvers: the whole matrix, or frozen factors of bodies."""
