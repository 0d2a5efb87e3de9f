# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton steps with frozen body factors and a dual Schur complement on the interface."""
