# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mechanisms as users declare them: matter, frames, joints and studies."""
