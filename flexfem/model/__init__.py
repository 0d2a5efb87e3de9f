# SPDX-License-Identifier: LGPL-3.0-or-later
"""Declarative, serial description of a multibody system."""
