# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of models, one file each.

A check has a function ``find(inspection)`` that returns or yields findings. It tells what is
admissible but probably unintended; what cannot be computed is refused by
``flexfem.model.validate``.
"""
