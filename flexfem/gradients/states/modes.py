# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of natural frequencies and damping ratios.

``P(lambda) = lambda^2 M + lambda C + K`` with the rows of constraints, see ``solvers.modal``. A
simple eigenvalue with its right and left vectors changes by

``dlambda = - y^H dP x / (y^H (2 lambda M + C) x)``

(Fox, Kapoor, AIAA J. 6 (1968) 2426-2429, for real symmetric matrices; Lancaster, Numer. Math. 6
(1964) 377-387), the mean of several equal ones by the mean of this over vectors with
``Y^H (2 lambda M + C) X`` diagonal.

About an equilibrium, or in a steady rotation, the state moves with a parameter by
``dq/dp = - A^-1 F_p``, one solve for each parameter: dP is the difference of the matrices of
neighbours moved along it. About a given state at rest it is that of neighbours at their own starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.analyses.modes import ModeOptions
from flexfem.core.status import Status
from flexfem.gradients.motion.trajectory import StoppedError
from flexfem.gradients.states.eigenvectors import (
    SHIFT,
    ComplexArray,
    Inverse,
    Vectors,
    classes_of,
    equal,
    times,
    vectors_of,
)
from flexfem.gradients.states.neighbours import (
    MATRICES,
    Parameter,
    check_path_independent,
    check_without_sliders,
    place,
)
from flexfem.model.model import Model
from flexfem.simulation.equilibria.operating_point import OperatingPoint
from flexfem.simulation.modes import doubts, modes_at
from flexfem.solvers.modal.linearization import Linearization, Matrices
from flexfem.solvers.modal.mode_shapes import Modes
from flexfem.solvers.modal.pencil import Pencil

__all__ = ["Frequencies"]

#: Part of a square of an eigenvalue that is round-off.
_REAL = 1e-9


class Frequencies:
    """Modes about a state, some of which are differentiated.

    Attributes:
        modes: the modes.
    """

    def __init__(
        self, model: Model, options: ModeOptions, comm: MPI.Intracomm,
        groups: Sequence[Sequence[int]],
    ) -> None:  # fmt: skip
        """Find them (collective).

        Args:
            model: the model.
            options: those of the modes; more are computed if the numbers ask for them.
            comm: communicator.
            groups: modes, from 1, whose means are differentiated.

        Raises:
            InputError: one of them is zero, or equal to one outside its group, or something has no
                derivatives.
            StoppedError: there is no state, or modes are doubtful.
        """
        if options.state is not None:
            raise InputError("gradient: modes about a checkpoint's state have no derivatives")
        self._options, self._comm = options, comm
        self._point = point = OperatingPoint(model, options, comm)
        check_path_independent(model, point.system)
        check_without_sliders(point.system)
        count = max(options.modes, *(number for group in groups for number in group))
        point.check_count("gradient", count)
        status = point.settle(options.spin)
        if status is not Status.OK:
            raise StoppedError(f"gradient: {point.failure(status)} in the search for the state")
        found = modes_at(point, options, count - options.modes + (count < point.freedoms))
        text = doubts(found, min(count, len(found)), options.accuracy)
        if text != "ok" or len(found) < count:
            raise StoppedError(f"gradient: {text if text != 'ok' else 'modes are missing'}")
        for group in groups:
            _check_apart(found, group)
        self.modes = found
        self._multipliers = point.linearization.multipliers.copy()
        pencil = Pencil.of(point.linearization)
        self._vectors = {
            numbers: self._of(pencil, numbers) for numbers in classes_of(found.eigenvalues, groups)
        }

    def _of(self, pencil: Pencil, numbers: tuple[int, ...]) -> Vectors:
        """Vectors of equal modes (collective)."""
        matrices, lin = pencil.matrices, pencil.linearization
        value = complex(np.mean([self.modes.eigenvalues[k - 1] for k in numbers]))
        shift = value * (1.0 + SHIFT)
        real = matrices.stiffness.copy()
        real.axpy((shift**2).real, matrices.mass)
        real.axpy(shift.real, matrices.damping)
        imaginary = None
        if pencil.damped or abs((shift**2).imag) > _REAL * abs(shift**2):
            imaginary = matrices.mass.copy()
            imaginary.scale((shift**2).imag)
            imaginary.axpy(shift.imag, matrices.damping)

        def weigh(x: ComplexArray, transposed: bool) -> ComplexArray:
            factor = np.conj(value) if transposed else value
            by_mass = times(matrices.mass, x, transposed=transposed)
            return 2.0 * factor * by_mass + times(matrices.damping, x, transposed=transposed)

        starts = np.zeros((len(numbers), lin.size), dtype=np.complex128)
        for start, k in zip(starts, numbers, strict=True):
            start[: lin.unknowns] = self.modes.shapes[k - 1]
        inverse = Inverse(real, imaginary)
        if not inverse.regular:
            raise StoppedError("gradient: the equations of motion are singular")
        return vectors_of(value, inverse, list(starts), lin.total, weigh)

    def gradients(self, parameters: Sequence[Parameter]) -> dict[int, ComplexArray]:
        """Derivatives (parameters,) of the eigenvalue of each mode, by its number (collective).

        Those of equal ones are that of their mean.
        """
        found = {k: np.zeros(len(parameters), dtype=np.complex128) for k in self._vectors}
        for p, parameter in enumerate(parameters):
            near = [(one, self._near(one.model)) for one in parameter.neighbours(MATRICES)]
            if self._point.is_equilibrium:
                points = [(one.offset, one.weight, point) for one, point in near]
                self._bring_to_equilibrium(points, parameter.text)
            for one, point in near:
                matrices = point.linearization.matrices()
                for numbers, own in self._vectors.items():
                    change = own.mean(partial(_times, matrices, own.value))
                    found[numbers][p] -= one.weight * change
        total = self._point.linearization.total
        sums = {numbers: total(changes) for numbers, changes in found.items()}
        return {number: changes for numbers, changes in sums.items() for number in numbers}

    def _near(self, model: Model) -> OperatingPoint:
        """A neighbour in the state of the options, or at its start (collective)."""
        point = OperatingPoint(model, self._options, self._comm)
        if not self._point.is_equilibrium:
            point.settle(0.0)
        return point

    def _bring_to_equilibrium(
        self, near: Sequence[tuple[float, float, OperatingPoint]], name: str
    ) -> None:
        """Move neighbours to their equilibria, to first order in the parameter (collective)."""
        base, spin = self._point, self._options.spin
        base.linearization.evaluate(self._multipliers)
        change = np.zeros(base.linearization.size)
        for _, weight, point in near:
            place(base.system, point.system, name)
            change += weight * self._evaluated(point, self._multipliers)
        solution = base.rotation(spin).solve(base.linearization, change)
        if solution is None:
            raise StoppedError("gradient: the equations of the equilibrium are singular")
        steps = base.linearization.split(solution.getArray())
        forces = base.linearization.rows_of(solution)
        for offset, _, point in near:
            point.linearization.move([-offset * step for step in steps])
            self._evaluated(point, self._multipliers - offset * forces)

    def _evaluated(self, point: OperatingPoint, multipliers: FloatArray) -> FloatArray:
        """Equations of a neighbour in steady rotation at its present state (collective)."""
        point.rotation(self._options.spin).set(point.system)
        lin: Linearization = point.linearization
        residual = lin.evaluate(multipliers)
        blocks = lin.split(residual)
        for part, own in zip(point.system.parts, blocks, strict=True):
            part.block.hold(own)
        return residual


def _times(matrices: Matrices, value: complex, x: ComplexArray) -> ComplexArray:
    """``P(value) x`` (collective)."""
    undamped = value**2 * times(matrices.mass, x) + times(matrices.stiffness, x)
    found: ComplexArray = undamped + value * times(matrices.damping, x)
    return found


def _check_apart(found: Modes, group: Sequence[int]) -> None:
    """Refuse modes without a derivative, and equal ones of which some are left out."""
    for number in group:
        if found.eigenvalues[number - 1] == 0.0 or found.frequencies[number - 1] == 0.0:
            raise InputError(
                f"gradient: mode {number} does not oscillate, and its frequency has no derivative"
            )
        alike = equal(found.eigenvalues, number)
        if not set(alike) <= set(group):
            raise InputError(
                f"gradient: modes {alike[0]} to {alike[-1]} have one frequency "
                f"({found.frequencies[number - 1]:g} Hz), and have no derivatives one by one; take "
                f"their mean, {alike[0]}-{alike[-1]}"
            )
