# SPDX-License-Identifier: LGPL-3.0-or-later
"""Places on bodies where no node is: frames at points of lines and surfaces, with derivatives."""
