# SPDX-License-Identifier: LGPL-3.0-or-later
"""Protocol of feedback laws.

A static law is a function ``law(t, y)`` of the time (s) and of the measurements ``y`` (n,) that
returns one number per output. A law with memory is an object with a method ``update(t, y)`` that
returns the same and is called once per sample, and an attribute ``state``, an array of numbers that
is its whole memory: checkpoints save it.
"""

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy.typing as npt

from flexfem._types import FloatArray

__all__ = ["Law", "SampledLaw", "StaticLaw"]

#: Outputs as a function of time (s) and measurements (n,).
StaticLaw = Callable[[float, FloatArray], npt.ArrayLike]


@runtime_checkable
class SampledLaw(Protocol):
    """A law with memory.

    Attributes:
        state: its memory, of any shape.
    """

    state: FloatArray

    def update(self, t: float, y: FloatArray) -> npt.ArrayLike:
        """Take the measurements ``y`` (n,) at a sample ``t`` (s); returns the outputs."""
        ...


Law = StaticLaw | SampledLaw
