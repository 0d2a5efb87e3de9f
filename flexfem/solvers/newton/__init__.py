# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton iteration with the exact tangent."""
