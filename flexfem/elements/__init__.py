# SPDX-License-Identifier: LGPL-3.0-or-later
"""Flexible elements: formulations, their compiled loops and their interface to the system."""
