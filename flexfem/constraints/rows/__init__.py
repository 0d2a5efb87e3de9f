# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows of joints on nodes: data, values, gradients, second derivatives and force laws."""
