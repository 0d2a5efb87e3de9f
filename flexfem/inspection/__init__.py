# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a model comes to, and what looks wrong in it, before anything is computed."""
