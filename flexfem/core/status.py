# SPDX-License-Identifier: LGPL-3.0-or-later
"""Outcome of numerical work: a value below the driver, never an exception."""

from enum import Enum

__all__ = ["Status"]


class Status(Enum):
    """Outcome; the value is the message."""

    OK = "ok"
    NOT_CONVERGED = "the Newton iteration did not converge"
    DIVERGED = "the Newton iteration diverged"
    INACCURATE = "the smallest step misses the error tolerance"
    EVENT = "an event cannot be located"
    LEFT = "a slider leaves its carrier"
    INSIDE_OUT = "an element is inverted"
    UNSOLVED = "the iterative solution of linear equations did not converge"
    SINGULAR = "the iteration matrix is singular: redundant constraints or a singular configuration"
