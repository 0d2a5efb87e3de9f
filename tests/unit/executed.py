# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lines of the package that a call executes: loops over cells show, whatever the machine does."""

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import flexfem

__all__ = ["executed_lines"]


def executed_lines[T](call: Callable[[], T]) -> tuple[T, int]:
    """Result of a function, and the number of lines of the package that it executes."""
    count, own = 0, str(Path(flexfem.__file__).parent)

    def trace(frame: FrameType, event: str, argument: Any) -> Callable[..., Any] | None:
        nonlocal count
        if not frame.f_code.co_filename.startswith(own):
            return None
        count += event == "line"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        result = call()
    finally:
        sys.settrace(before)
    return result, count
