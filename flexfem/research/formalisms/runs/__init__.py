# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs of mechanisms, comparisons of formalisms, and tables of element matrices."""
