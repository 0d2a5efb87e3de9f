# SPDX-License-Identifier: LGPL-3.0-or-later
"""Studies of a case: many runs with different options, in processes of their own."""
