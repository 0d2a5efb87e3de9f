# SPDX-License-Identifier: LGPL-3.0-or-later
"""Robots described in URDF files, as bodies and joints of a model."""
