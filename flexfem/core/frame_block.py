# SPDX-License-Identifier: LGPL-3.0-or-later
"""Old place of ``flexfem.core.nodes.frame_block``: it warns, for one version."""

import warnings
from importlib import import_module
from typing import Any


def __getattr__(name: str) -> Any:
    """Take a name from where it is now."""
    value = getattr(import_module("flexfem.core.nodes.frame_block"), name)
    warnings.warn(
        "flexfem.core.frame_block is flexfem.core.nodes.frame_block now",
        DeprecationWarning,
        stacklevel=2,
    )
    return value
