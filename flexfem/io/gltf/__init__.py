# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions as animated glTF files: the writer, and the container of description and arrays."""
