# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parts of compiled loops, called by tests."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numba

__all__ = ["called"]


@cache
def called(function: Callable[..., Any]) -> Callable[..., Any]:
    """A compiled loop that does nothing but call a part of loops, which Python cannot."""

    def loop(*arguments: Any) -> Any:
        return function(*arguments)

    return numba.njit(loop)
