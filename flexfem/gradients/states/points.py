# SPDX-License-Identifier: LGPL-3.0-or-later
"""States about which models are linearised, and those of models that differ in one parameter.

About an equilibrium, or in a steady rotation, the state moves with a parameter by
``dq/dp = - A^-1 F_p``, one solve for each parameter: neighbours are moved along it. About a given
state at rest they are at their own starts.
"""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.analyses.modes import StateOptions
from flexfem.core.status import Status
from flexfem.gradients.motion.trajectory import StoppedError
from flexfem.gradients.states.neighbours import (
    MATRICES,
    Neighbour,
    Parameter,
    check_path_independent,
    check_without_sliders,
    place,
)
from flexfem.model.model import Model
from flexfem.simulation.equilibria.operating_point import OperatingPoint

__all__ = ["LinearizedState"]


class LinearizedState:
    """A state about which a model is linearised.

    Attributes:
        point: the model in this state after :meth:`settle`.
    """

    def __init__(self, model: Model, options: StateOptions, comm: MPI.Intracomm, of: str) -> None:
        """Build the system (collective).

        Args:
            model: the model.
            options: those of the state.
            comm: communicator.
            of: what is linearised, in messages.

        Raises:
            InputError: something in the model or the options has no derivatives.
        """
        if options.state is not None:
            raise InputError(f"gradient: {of} about a checkpoint's state have no derivatives")
        self._options, self._comm = options, comm
        self.point = OperatingPoint(model, options, comm)
        check_path_independent(model, self.point.system)
        check_without_sliders(self.point.system)

    def settle(self) -> None:
        """Find the state (collective).

        Raises:
            StoppedError: there is none.
        """
        status = self.point.settle(self._options.spin)
        if status is not Status.OK:
            raise StoppedError(
                f"gradient: {self.point.failure(status)} in the search for the state"
            )

    def near(self, parameter: Parameter) -> list[tuple[float, OperatingPoint]]:
        """Neighbours in their states, with their weights in differences of matrices (collective).

        Raises:
            StoppedError: the equations of the equilibrium are singular.
        """
        near = [(one, self._start(one.model)) for one in parameter.neighbours(MATRICES)]
        if self.point.is_equilibrium:
            self._bring_to_equilibrium(near, parameter.text)
        return [(one.weight, point) for one, point in near]

    def _start(self, model: Model) -> OperatingPoint:
        """A neighbour in the state of the options, or at its start (collective)."""
        point = OperatingPoint(model, self._options, self._comm)
        if not self.point.is_equilibrium:
            point.settle(0.0)
        return point

    def _bring_to_equilibrium(
        self, near: Sequence[tuple[Neighbour, OperatingPoint]], name: str
    ) -> None:
        """Move neighbours to their equilibria, to first order in the parameter (collective)."""
        base = self.point
        multipliers = base.linearization.multipliers.copy()
        base.linearization.evaluate(multipliers)
        change = np.zeros(base.linearization.size)
        for one, point in near:
            place(base.system, point.system, name)
            change += one.weight * self._evaluated(point, multipliers)
        solution = base.rotation(self._options.spin).solve(base.linearization, change)
        if solution is None:
            raise StoppedError("gradient: the equations of the equilibrium are singular")
        steps = base.linearization.split(solution.getArray())
        forces = base.linearization.rows_of(solution)
        for one, point in near:
            point.linearization.move([-one.offset * step for step in steps])
            self._evaluated(point, multipliers - one.offset * forces)

    def _evaluated(self, point: OperatingPoint, multipliers: FloatArray) -> FloatArray:
        """Equations of a neighbour in steady rotation at its present state (collective)."""
        point.rotation(self._options.spin).set(point.system)
        residual = point.linearization.evaluate(multipliers)
        blocks = point.linearization.split(residual)
        for part, own in zip(point.system.parts, blocks, strict=True):
            part.block.hold(own)
        return residual
