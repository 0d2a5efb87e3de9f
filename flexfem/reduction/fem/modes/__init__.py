# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shape functions of a reduced body: eigenmodes and static responses."""
