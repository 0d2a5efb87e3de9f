# SPDX-License-Identifier: LGPL-3.0-or-later
"""Model order reduction: finite elements to the reduced data of bodies in a floating frame."""
