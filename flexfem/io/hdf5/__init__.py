# SPDX-License-Identifier: LGPL-3.0-or-later
"""HDF5 files: checkpoints and reduced bodies, read with care."""
