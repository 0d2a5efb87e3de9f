# SPDX-License-Identifier: LGPL-3.0-or-later
"""Materials and beam sections."""
