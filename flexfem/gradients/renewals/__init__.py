# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps that a motion took, and derivatives of states that are made consistent between them."""
