# SPDX-License-Identifier: LGPL-3.0-or-later
"""Old name of ``flexfem.layout.family``, deprecated with a warning for one version."""

import warnings
from importlib import import_module
from typing import Any


def __getattr__(name: str) -> Any:
    """Return a name of the new module, with a warning."""
    value = getattr(import_module("flexfem.layout.family"), name)
    warnings.warn(
        "flexfem.system.family is flexfem.layout.family now", DeprecationWarning, stacklevel=2
    )
    return value
