# SPDX-License-Identifier: LGPL-3.0-or-later
"""Constants of arbitrary beam sections by finite elements over the section."""
