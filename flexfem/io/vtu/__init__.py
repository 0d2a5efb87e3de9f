# SPDX-License-Identifier: LGPL-3.0-or-later
"""Series of VTU files: beams, shells, bodies and joints as unstructured grids."""
