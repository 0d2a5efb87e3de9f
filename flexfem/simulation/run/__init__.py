# SPDX-License-Identifier: LGPL-3.0-or-later
"""The run loop of all analyses: set-up, records, checkpoints, signals and the outcome."""
