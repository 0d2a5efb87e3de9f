# SPDX-License-Identifier: LGPL-3.0-or-later
"""Material laws of solids: strain energies, and laws with internal variables."""
