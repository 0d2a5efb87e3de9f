# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion step by step: step sizes, jumps of drives, events, sliders that leave their lines."""
