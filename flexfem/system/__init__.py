# SPDX-License-Identifier: LGPL-3.0-or-later
"""From the declarative model to blocks, residuals and matrices on the ranks."""
