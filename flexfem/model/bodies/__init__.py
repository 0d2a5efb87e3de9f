# SPDX-License-Identifier: LGPL-3.0-or-later
"""Declarations of bodies, and the base class of those of further families."""
