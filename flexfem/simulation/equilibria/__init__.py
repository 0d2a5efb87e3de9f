# SPDX-License-Identifier: LGPL-3.0-or-later
"""Equilibria of a model: at rest, along a path of loads, as states to linearise about."""
