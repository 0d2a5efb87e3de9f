# SPDX-License-Identifier: LGPL-3.0-or-later
"""Summary of a model, and checks of it, before anything is computed."""
