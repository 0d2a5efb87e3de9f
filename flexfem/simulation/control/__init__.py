# SPDX-License-Identifier: LGPL-3.0-or-later
"""Controllers of a run, and their measurements."""
