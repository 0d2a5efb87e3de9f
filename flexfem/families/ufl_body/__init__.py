# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of finite elements whose strain energy the user writes in UFL."""
