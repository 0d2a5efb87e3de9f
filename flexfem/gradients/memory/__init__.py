# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a motion carries from step to step beside its nodes, and its derivatives."""
