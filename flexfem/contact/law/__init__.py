# SPDX-License-Identifier: LGPL-3.0-or-later
"""Normal forces, damping and friction of contacts."""
