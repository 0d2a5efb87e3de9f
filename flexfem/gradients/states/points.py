# SPDX-License-Identifier: LGPL-3.0-or-later
"""States about which models are linearised, and those of models that differ in one parameter.

About an equilibrium, or in a steady rotation, the state moves with a parameter by
``dq/dp = - A^-1 F_p``: neighbours are moved along it, on both sides by the same central difference
with their own step, so that differences of what depends on them have even powers of the step alone.
About a given state at rest they are at their own starts.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

from mpi4py import MPI
from petsc4py import PETSc

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.analyses.modes import StateOptions
from flexfem.core.status import Status
from flexfem.gradients.motion.trajectory import StoppedError
from flexfem.gradients.states.neighbours import (
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

    def near(self, parameter: Parameter, step: float) -> tuple[OperatingPoint, OperatingPoint]:
        """Neighbours with a smaller and a larger value, in their states (collective).

        Raises:
            InputError: there are none with such values.
            StoppedError: the equations of the equilibrium are singular.
        """
        near = self._start(parameter.beside(-step)), self._start(parameter.beside(step))
        if self.point.is_equilibrium:
            self._bring_to_equilibrium(near, step, parameter.text)
        return near

    def _start(self, model: Model) -> OperatingPoint:
        """A neighbour in the state of the options, or at its start (collective)."""
        point = OperatingPoint(model, self._options, self._comm)
        if not self.point.is_equilibrium:
            point.settle(0.0)
        return point

    @cached_property
    def _solve(self) -> Callable[[FloatArray], PETSc.Vec | None]:
        """Solver of the linearised equations of the state (collective)."""
        lin = self.point.linearization
        lin.evaluate(lin.multipliers.copy())
        return self.point.rotation(self._options.spin).solver(lin)

    def _bring_to_equilibrium(
        self, near: tuple[OperatingPoint, OperatingPoint], step: float, name: str
    ) -> None:
        """Move neighbours to their equilibria, to first order in the parameter (collective)."""
        lin = self.point.linearization
        multipliers = lin.multipliers.copy()
        for point in near:
            place(self.point.system, point.system, name)
        before, after = (self._evaluated(point, multipliers) for point in near)
        solution = self._solve((after - before) / (2.0 * step))
        if solution is None:
            raise StoppedError("gradient: the equations of the equilibrium are singular")
        change, forces = lin.split(solution.getArray()), lin.rows_of(solution)
        for way, point in zip((step, -step), near, strict=True):
            point.linearization.move([way * own for own in change])
            self._evaluated(point, multipliers + way * forces)

    def _evaluated(self, point: OperatingPoint, multipliers: FloatArray) -> FloatArray:
        """Equations of a neighbour in steady rotation at its present state (collective)."""
        point.rotation(self._options.spin).set(point.system)
        residual = point.linearization.evaluate(multipliers)
        blocks = point.linearization.split(residual)
        for part, own in zip(point.system.parts, blocks, strict=True):
            part.block.hold(own)
        return residual
