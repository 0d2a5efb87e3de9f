# SPDX-License-Identifier: LGPL-3.0-or-later
"""Progress bar in a Jupyter notebook."""

import sys
import warnings
from typing import Any

__all__ = ["bar_class", "in_notebook"]


def in_notebook() -> bool:
    """Return True in the kernel of a notebook, whose streams are no terminals."""
    return "ipykernel.zmqshell" in sys.modules


def bar_class() -> Any:
    """The class of tqdm's bars: a widget in a notebook with ipywidgets, else text."""
    if not in_notebook():
        from tqdm import tqdm

        return tqdm
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that there are no ipywidgets: text is shown instead
        from tqdm.auto import tqdm as automatic

    return automatic
