# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton iteration and its linear solvers: the whole nest, or frozen factors of the bodies."""
