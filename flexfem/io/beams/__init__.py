# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beams from files: tables of sections, and blades of BeamDyn and windIO."""
