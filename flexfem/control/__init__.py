# SPDX-License-Identifier: LGPL-3.0-or-later
"""Feedback laws: the outputs of a controller as functions of its measurements."""
