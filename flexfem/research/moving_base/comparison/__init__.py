# SPDX-License-Identifier: LGPL-3.0-or-later
"""The beam on a moving base by other theories, to compare with."""
