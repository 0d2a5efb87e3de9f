# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of models, one file each.

A check has a function ``find(inspection)`` that returns or yields findings. Findings are admissible
but probably unintended; models that cannot be computed are refused by ``flexfem.model.validate``.
"""
