# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of frequency responses, from loads, actuators and drives to probes.

The transfer function of a linear model is ``H(s) = c x`` with ``P(s) x = b``, where
``P(s) = s^2 M + s C + K`` has the rows of constraints, b is the input and c measures displacements
and, times s, rates. It changes with a parameter by

``dH = dc x + c P^-1 (db - dP x)``,

one solve with the factors of P (Arora, Haug, AIAA J. 17 (1979) 970-974, section III, for statics).
The differences are those of neighbours in their own states, see ``points``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.analyses.modes import LinearOptions
from flexfem.gradients.motion.support import check_alike
from flexfem.gradients.motion.trajectory import StoppedError
from flexfem.gradients.states.eigenvectors import (
    ComplexArray,
    Inverse,
    pencil_change,
    pencil_inverse,
    pencil_times,
)
from flexfem.gradients.states.neighbours import Parameter, derivatives_by
from flexfem.gradients.states.points import LinearizedState
from flexfem.model.model import Model
from flexfem.options import meant
from flexfem.simulation.equilibria.operating_point import OperatingPoint
from flexfem.simulation.linear_model import output_names, output_rates
from flexfem.solvers.modal.linearization import Matrices
from flexfem.solvers.modal.pencil import Pencil
from flexfem.solvers.modal.reduced_equations import Inputs

__all__ = ["Response", "Responses"]

#: Response, relative to what unknowns of its size would be measured as, that is rounding.
_NOTHING = 1e-13
#: A number that is not negative.
_NUMBER = r"\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+"


@dataclass(frozen=True)
class Response:
    """A number of a transfer function, such as ``gain:tip_z/push@12.5``.

    Attributes:
        name: text in tables.
        kind: "gain", in units of the output for one of the input, or "phase", rad.
        output: column of a probe.
        input: name of a load, an actuator or a row of a drive.
        frequency: Hz.
    """

    name: str
    kind: str
    output: str
    input: str
    frequency: float

    @classmethod
    def of(cls, name: str) -> Response:
        """A response by its name.

        Raises:
            ValueError: it is not of the form.
        """
        found = re.fullmatch(rf"(gain|phase):([^/]+)/(.+)@({_NUMBER})", name.strip())
        if found is None:
            raise ValueError(
                "gradient: with LinearOptions numbers are gain:OUTPUT/INPUT@HZ and "
                f"phase:OUTPUT/INPUT@HZ, as in gain:tip_z/push@12.5, got {_checks.show(name)}"
            )
        return cls(name.strip(), found[1], found[2], found[3], float(found[4]))

    def number(self, value: complex) -> float:
        """The number of a value of the transfer function."""
        return abs(value) if self.kind == "gain" else math.atan2(value.imag, value.real)

    def change(self, value: complex, changes: ComplexArray) -> FloatArray:
        """Its changes with those of the value, not zero."""
        ratio = changes / value
        return np.asarray(abs(value) * ratio.real if self.kind == "gain" else ratio.imag)


class Responses:
    """Responses of a model about a state, with their derivatives.

    Attributes:
        values: of the transfer functions.
    """

    def __init__(
        self, model: Model, options: LinearOptions, comm: MPI.Intracomm, wanted: Sequence[Response]
    ) -> None:
        """Find them (collective).

        Args:
            model: the model.
            options: of the state.
            comm: communicator.
            wanted: the responses.

        Raises:
            InputError: one does not exist or is zero, or something has no derivatives.
            StoppedError: there is no state, or a mode without damping has this frequency.
        """
        if options.modes:
            raise InputError(
                f"gradient: linear models reduced to {options.modes} modes have no derivatives; "
                "leave modes out, responses are those of all degrees of freedom, however many"
            )
        self._model, self._wanted = model, list(wanted)
        self._state = LinearizedState(model, options, comm, "linear models")
        self._state.settle()
        lin = self._state.point.linearization
        pencil = Pencil.of(lin)
        self._check_names(Inputs.of(lin, len(model.loads)))
        #: Motions by input and frequency, in the order of ``_asked``.
        self._asked = sorted({(one.input, one.frequency) for one in wanted})
        self._inverses = self._factored(pencil)
        rights = self._rights(self._state.point)
        self._motions = self._solved(rights)
        self._columns = {name: k for k, name in enumerate(output_names(model))}
        self.values = self._of(self._measured(self._state.point, self._motions))
        self._check_sizes()
        left = self._solved(rights - self._forces(pencil.matrices))
        self._rounding = np.abs(self._of(self._measured(self._state.point, left)))

    def _check_names(self, inputs: Inputs) -> None:
        """Refuse outputs and inputs that do not exist, and drives at rest."""
        outputs, drives = output_names(self._model), inputs.drives
        names = (*(load.name for load in self._model.loads), *inputs.actuators, *drives)
        for one in self._wanted:
            for kind, name, every in (
                ("output", one.output, outputs), ("input", one.input, names)
            ):  # fmt: skip
                if name not in every:
                    hint = meant(name, every) or f"there are {', '.join(every) or 'none'}"
                    raise InputError(f'gradient: linear models have no {kind} "{name}", {hint}')
            if one.input in drives and one.frequency == 0.0:
                raise InputError(
                    f'gradient: "{one.name}" is infinite, as the input of a drive is its '
                    "acceleration; take another frequency than 0"
                )
        self._numbers = {name: k for k, name in enumerate(names)}

    def _factored(self, pencil: Pencil) -> Mapping[float, Inverse]:
        """Inverses of the equations by frequency (collective)."""
        found = {}
        for frequency in {frequency for _, frequency in self._asked}:
            inverse = pencil_inverse(pencil.matrices, _shift(frequency), damped=pencil.damped)
            if inverse is None:
                raise StoppedError(
                    f"gradient: there is no response at {frequency:g} Hz, where the equations of "
                    "motion are singular"
                )
            found[frequency] = inverse
        return found

    def _rights(self, point: OperatingPoint) -> ComplexArray:
        """Inputs (asked, n) on this rank's range (collective)."""
        lin = point.linearization
        inputs = Inputs.of(lin, len(self._model.loads))
        forces, rows = len(inputs.forces), lin.system.constraints.owned_count
        found = np.zeros((len(self._asked), lin.size), dtype=np.complex128)
        for own, (name, frequency) in zip(found, self._asked, strict=True):
            number = self._numbers[name]
            if number < forces:
                own[: lin.unknowns] = inputs.forces[number]
            else:  # accelerations of targets
                target = inputs.targets[number - forces] / _shift(frequency) ** 2
                own[lin.unknowns : lin.unknowns + rows] = target
        return found

    def _solved(self, rights: ComplexArray) -> ComplexArray:
        """Motions (asked, n) of right-hand sides, along fixed unknowns zero (collective)."""
        lin, found = self._state.point.linearization, np.empty_like(rights)
        for own, right, (_, frequency) in zip(found, rights, self._asked, strict=True):
            for values in (right.real, right.imag):
                for part, block in zip(lin.system.parts, lin.split(values), strict=True):
                    part.block.hold(block)
            own[:] = self._inverses[frequency].solve(right)
        return found

    def _measured(self, point: OperatingPoint, motions: ComplexArray) -> ComplexArray:
        """Outputs (p, asked) of motions (asked, n) (collective)."""
        nodes = motions[:, : point.linearization.unknowns]
        count = len(nodes)
        _, by_place, by_rate = output_rates(
            self._model, point, np.concatenate([nodes.real, nodes.imag])
        )
        place, rate = (own[:, :count] + 1j * own[:, count:] for own in (by_place, by_rate))
        found: ComplexArray = place + rate * np.array([_shift(own) for _, own in self._asked])
        return found

    def _of(self, outputs: ComplexArray) -> ComplexArray:
        """Those of the responses that are wanted (wanted, ...) of (p, asked, ...)."""
        rows = [self._columns[one.output] for one in self._wanted]
        places = [self._asked.index((one.input, one.frequency)) for one in self._wanted]
        return np.asarray(outputs[rows, places])

    def _check_sizes(self) -> None:
        """Refuse responses that are rounding (collective)."""
        comm = self._state.point.system.comm
        unknowns = self._state.point.linearization.unknowns
        signs = np.random.default_rng(comm.rank).choice((-1.0, 1.0), self._motions.shape)
        largest = np.abs(self._motions[:, :unknowns]).max(axis=1, initial=0.0)
        comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
        every = self._of(self._measured(self._state.point, signs * largest[:, np.newaxis]))
        for one, value, size in zip(self._wanted, self.values, np.abs(every), strict=True):
            if not abs(value) > _NOTHING * size:
                raise InputError(
                    f'gradient: "{one.name}" has no derivative, as {one.input} does not act on '
                    f"{one.output}"
                )

    def gradients(self, parameters: Sequence[Parameter]) -> list[ComplexArray]:
        """Derivatives (parameters,) of each value (collective)."""
        found = np.array([self._changes(one) for one in parameters])
        return list(found.reshape(len(parameters), len(self.values)).T)

    def _changes(self, parameter: Parameter) -> ComplexArray:
        """Derivatives of each value by a number (collective)."""

        def difference(step: float) -> ComplexArray:
            before, after = self._state.near(parameter, step)
            for point in (before, after):
                check_alike(self._model, point.serial.model, parameter.text)
            change = self._rights(after) - self._rights(before)
            near = (point.linearization.matrices() for point in (before, after))
            change -= self._forces(pencil_change(*near))
            moved = self._measured(self._state.point, self._solved(change))
            sides = (self._measured(point, self._motions) for point in (after, before))
            return self._of(moved + np.subtract(*sides)) / (2.0 * step)

        return derivatives_by(parameter, difference, self._rounding)

    def _forces(self, matrices: Matrices) -> ComplexArray:
        """Products (asked, n) of equations of motion with the motions (collective)."""
        pairs = zip(self._asked, self._motions, strict=True)
        return np.array([pencil_times(matrices, _shift(own), x) for (_, own), x in pairs])


def _shift(frequency: float) -> complex:
    """The s of a frequency in Hz."""
    return 2j * math.pi * frequency
