# SPDX-License-Identifier: LGPL-3.0-or-later
"""Force elements: joints whose rows have one law together, with states of its own."""
