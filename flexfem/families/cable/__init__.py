# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mass of cables over eyelets and sheaves."""
