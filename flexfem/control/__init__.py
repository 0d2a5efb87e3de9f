# SPDX-License-Identifier: LGPL-3.0-or-later
"""Laws of feedback: what a controller computes from what it measures."""
