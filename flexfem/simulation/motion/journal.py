# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a simulation does with its state, for those who follow a motion step by step."""

from collections.abc import Sequence

from flexfem._types import FloatArray
from flexfem.integrators.integrator import Integrator

__all__ = ["Journal"]


class Journal:
    """Is told of every change of the accepted state, after it; does nothing by itself."""

    def stepped(self, scheme: Integrator, h: float) -> None:
        """A step of size ``h`` (s) was accepted."""

    def happened(self, events: Sequence[int]) -> None:
        """These events, by their numbers, have happened at the state; nothing is changed yet."""

    def at_once(self) -> None:
        """An event is about to happen at a state to which it did not cut a step."""

    def switched(self) -> None:
        """Joints were closed, locked or opened; velocities are not consistent yet."""

    def rebounded(self, restitution: FloatArray) -> None:
        """Rates of rows (r,) were reversed by these factors, those of others made zero."""

    def renewed(self) -> None:
        """Velocities, accelerations and multipliers were made consistent at the same positions."""

    def measured(self) -> None:
        """Controllers have measured the state once more, after it was made consistent."""

    def began_parts(self) -> None:
        """``Integrator.begin_parts`` was called."""

    def ended_parts(self, ratio: float) -> None:
        """``Integrator.end_parts`` was called with this ratio."""
