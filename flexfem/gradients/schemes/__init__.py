# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time integrators whose steps have derivatives: what each carries over a step, ahead and back."""
