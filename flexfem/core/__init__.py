# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vocabulary shared by all layers: frames, markers, joints, blocks, states."""
