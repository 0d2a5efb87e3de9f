# SPDX-License-Identifier: LGPL-3.0-or-later
"""One body on a mesh: forms, interfaces tied to regions, integrals, lines, surface."""
