# SPDX-License-Identifier: LGPL-3.0-or-later
"""What an analysis comes to."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from flexfem._types import FloatArray

__all__ = ["Outcome", "Results"]

#: Headline results from the columns of the history.
Results = Callable[[Mapping[str, FloatArray]], Mapping[str, float]]


@dataclass(frozen=True)
class Outcome:
    """What a run came to.

    Attributes:
        status: "ok" or the reason of failure.
        summary: what ``summary.json`` holds.
        history: columns of the history, angles unwrapped; empty on other ranks than the first.
    """

    status: str
    summary: Mapping[str, Any]
    history: Mapping[str, FloatArray] = field(default_factory=dict)
