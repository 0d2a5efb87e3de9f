# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sources of the documentation; "make docs" builds it. Not part of the wheel."""
