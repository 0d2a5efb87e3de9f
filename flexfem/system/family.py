# SPDX-License-Identifier: LGPL-3.0-or-later
"""Old place of ``flexfem.layout.family``: it warns, for one version."""

import warnings
from importlib import import_module
from typing import Any


def __getattr__(name: str) -> Any:
    """Take a name from where it is now."""
    value = getattr(import_module("flexfem.layout.family"), name)
    warnings.warn(
        "flexfem.system.family is flexfem.layout.family now", DeprecationWarning, stacklevel=2
    )
    return value
