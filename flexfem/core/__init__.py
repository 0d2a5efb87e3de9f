# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vocabulary shared by all layers: markers, joints as rows, loads, states.

``nodes`` holds nodes with frames and their steps, ``places`` frames at points of lines and
surfaces.
"""
