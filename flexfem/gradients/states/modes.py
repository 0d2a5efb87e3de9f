# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of natural frequencies and damping ratios.

``P(lambda) = lambda^2 M + lambda C + K`` with the rows of constraints, see ``solvers.modal``. A
simple eigenvalue with its right and left vectors changes by

``dlambda = - y^H dP x / (y^H (2 lambda M + C) x)``

(Fox, Kapoor, AIAA J. 6 (1968) 2426-2429, for real symmetric matrices; Lancaster, Numer. Math. 6
(1964) 377-387), the mean of several equal ones by the mean of this over vectors with
``Y^H (2 lambda M + C) X`` diagonal.

dP is the difference of the matrices of neighbours in their own states, see ``points``, with steps
as long as suit ``y^H dP x``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem.analyses.modes import ModeOptions
from flexfem.gradients.motion.trajectory import StoppedError
from flexfem.gradients.states.eigenvectors import (
    SHIFT,
    ComplexArray,
    Vectors,
    classes_of,
    equal,
    pencil_change,
    pencil_inverse,
    pencil_times,
    times,
    vectors_of,
)
from flexfem.gradients.states.neighbours import Parameter, derivatives_by, derivatives_of_classes
from flexfem.gradients.states.points import LinearizedState
from flexfem.model.model import Model
from flexfem.simulation.modes import doubts, modes_at
from flexfem.solvers.modal.mode_shapes import Modes
from flexfem.solvers.modal.pencil import Pencil

__all__ = ["Frequencies"]


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
        self._state = LinearizedState(model, options, comm, "modes")
        point = self._state.point
        count = max(options.modes, *(number for group in groups for number in group))
        point.check_count("gradient", count)
        self._state.settle()
        found = modes_at(point, options, count - options.modes + (count < point.freedoms))
        text = doubts(found, min(count, len(found)), options.accuracy)
        if text != "ok" or len(found) < count:
            raise StoppedError(f"gradient: {text if text != 'ok' else 'modes are missing'}")
        for group in groups:
            _check_apart(found, group)
        self.modes = found
        pencil = Pencil.of(point.linearization)
        self._vectors = {
            numbers: self._of(pencil, numbers) for numbers in classes_of(found.eigenvalues, groups)
        }

    def _of(self, pencil: Pencil, numbers: tuple[int, ...]) -> Vectors:
        """Vectors of equal modes (collective)."""
        matrices, lin = pencil.matrices, pencil.linearization
        value = complex(np.mean([self.modes.eigenvalues[k - 1] for k in numbers]))
        shift = value * (1.0 + SHIFT)
        inverse = pencil_inverse(matrices, shift, damped=pencil.damped)
        if inverse is None:
            raise StoppedError("gradient: the equations of motion are singular")

        def weigh(x: ComplexArray, transposed: bool) -> ComplexArray:
            factor = np.conj(value) if transposed else value
            by_mass = times(matrices.mass, x, transposed=transposed)
            return 2.0 * factor * by_mass + times(matrices.damping, x, transposed=transposed)

        starts = np.zeros((len(numbers), lin.size), dtype=np.complex128)
        for start, k in zip(starts, numbers, strict=True):
            start[: lin.unknowns] = self.modes.shapes[k - 1]
        apply = partial(pencil_times, matrices, value)
        return vectors_of(value, inverse, list(starts), lin.total, apply, weigh)

    def gradients(self, parameters: Sequence[Parameter]) -> dict[int, ComplexArray]:
        """Derivatives (parameters,) of the eigenvalue of each mode, by its number (collective).

        Those of equal ones are that of their mean.
        """
        return derivatives_of_classes(parameters, self._changes, self._vectors)

    def _changes(self, parameter: Parameter) -> ComplexArray:
        """Derivatives of all vectors' eigenvalues by a number (collective)."""
        every = list(self._vectors.values())

        def difference(step: float) -> ComplexArray:
            before, after = (
                point.linearization.matrices() for point in self._state.near(parameter, step)
            )
            change = pencil_change(before, after)
            own = [one.mean(partial(pencil_times, change, one.value)) for one in every]
            total = self._state.point.linearization.total(np.array(own))
            return np.asarray(total / (-2.0 * step))

        return derivatives_by(parameter, difference, np.array([one.rounding for one in every]))


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
