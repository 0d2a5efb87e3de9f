# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elementary functions of two markers, with their derivatives, as compiled kernels."""
