# SPDX-License-Identifier: LGPL-3.0-or-later
"""The family of shells: layout, loads and measures of both elements, and their UFL forms."""
