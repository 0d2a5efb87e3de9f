# SPDX-License-Identifier: LGPL-3.0-or-later
"""The mechanical part of a model, and the places of markers in it."""
