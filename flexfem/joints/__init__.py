# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints, drives and springs: one file each, each a list of rows."""
