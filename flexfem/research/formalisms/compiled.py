# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled forms of bodies and joints, with the entries of the coordinate vector they act on."""

from collections.abc import Mapping, Sequence
from copy import copy
from functools import cache
from typing import Any

import basix.ufl
import numpy as np
import ufl

from flexfem._types import FloatArray, IntArray
from flexfem.kernels.driver import CellKernel, add_entries, evaluate, plain_cells
from flexfem.kernels.records import Memory
from flexfem.research.formalisms.coordinates import Coordinates, coordinate_kernel
from flexfem.research.formalisms.derivation import BodyEnergies, kernel_parts
from flexfem.research.formalisms.description.frames import Frame
from flexfem.research.formalisms.description.joints import AppliedForce, Constraint, EndState
from flexfem.research.formalisms.description.matter import Matter

__all__ = ["CompiledBody", "CompiledJoint", "energies_of"]

_D = ufl.derivative


def energies_of(matter: Matter, frame: Frame) -> BodyEnergies:
    """Energies of this matter in this frame; all of one kind share their forms and kernels."""
    key = (type(matter), matter.degree, matter.components, type(frame))
    if key not in _ENERGIES:
        _ENERGIES[key] = BodyEnergies(matter, frame)
    return _ENERGIES[key]


_ENERGIES: dict[tuple[Any, ...], BodyEnergies] = {}


@cache
def _body_kernels(energies_id: int, name: str) -> list[tuple[CellKernel, tuple[str, ...]]]:
    """Kernels of a form of some energies, and the names of their constants in their order."""
    energies = next(e for e in _ENERGIES.values() if id(e) == energies_id)
    names = {constant: name for name, constant in energies.constants.items()}
    return [
        (
            coordinate_kernel(part, energies.fields),
            tuple(names[constant] for constant in part.constants()),
        )
        for part in kernel_parts(getattr(energies, name))
    ]


class CompiledBody:
    """A body's cells and kernels.

    Attributes:
        entries: (m, k) of each cell in the vector of all coordinates.
        points: (m, 3 nodes) corners of the cells, m.
        energies: symbolic energies.
    """

    def __init__(
        self, energies: BodyEnergies, entries: IntArray, points: FloatArray,
        numbers: Mapping[str, float], gravity: FloatArray,
    ) -> None:  # fmt: skip
        """Note connectivity and numbers; kernels are compiled when first used."""
        self.energies = energies
        self._connect(entries, points)
        self._numbers = {name: np.array([value]) for name, value in numbers.items()}
        axes = energies.constants["gravity"].ufl_shape[0]
        self._numbers["gravity"] = gravity[:axes].copy()
        self._calls: dict[str, list[tuple[Memory, FloatArray, FloatArray]]] = {}

    def _connect(self, entries: IntArray, points: FloatArray) -> None:
        """Take cells."""
        self.entries, self.points = entries, points
        nothing = np.empty((len(entries), 0))
        self._cells = plain_cells(nothing, entries.astype(np.int32), np.ascontiguousarray(points))

    def tiled(self, count: int) -> "CompiledBody":
        """The same with its cells repeated up to a number, for timings of kernels."""
        times = -(-count // len(self.entries))
        other = copy(self)
        other._connect(
            np.tile(self.entries, (times, 1))[:count], np.tile(self.points, (times, 1))[:count]
        )
        return other

    def _call(
        self, name: str, weights: Sequence[float]
    ) -> list[tuple[Memory, FloatArray, FloatArray]]:
        """Kernels of a form, their constants, and the weights' place among these."""
        if name not in self._calls:
            kernels = _body_kernels(id(self.energies), name)
            self._calls[name] = [
                (kernel.memory, *self._constants(names)) for kernel, names in kernels
            ]
        if weights:
            for _, _, room in self._calls[name]:
                room[:] = 0.0
                room[: len(weights)] = weights
        return self._calls[name]

    def _constants(self, names: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
        numbers = self._numbers | {"weights": np.zeros(4)}
        constants = np.concatenate([*(numbers[n] for n in names), np.zeros(4)])
        before = names[: names.index("weights")] if "weights" in names else names
        at = sum(len(numbers[n]) for n in before)  # behind all constants if there are no weights
        return constants, constants[at : at + 4]

    def add(self, name: str, weights: Sequence[float], state: Coordinates, out: FloatArray) -> None:
        """Add the vector or the matrix of a form, for example "lagrange", with these weights.

        Args:
            name: of the form.
            weights: of its parts, none for all alike.
            state: of the mechanism.
            out: (n + 1, 1) for a vector, (n + 1, n + 1) for a matrix.
        """
        for kernel, constants, _ in self._call(name, weights):
            add_entries(kernel, self._cells.memory, state.memory, constants, out)

    def value(self, name: str, weights: Sequence[float], state: Coordinates) -> float:
        """Value of a form without arguments."""
        total, values = 0.0, np.empty((len(self.entries), 1))
        for kernel, constants, _ in self._call(name, weights):
            evaluate(kernel, self._cells.memory, state.memory, constants, values)
            total += float(values.sum())
        return total


class CompiledJoint:
    """A joint's kernels: an "element" whose coordinates are those of its ends.

    Attributes:
        entries: (k,) of its coordinates in the vector of all.
        count: number of values that its function returns.
        distinct: True if no free coordinate occurs twice.
    """

    def __init__(
        self, joint: Constraint | AppliedForce, ends: Sequence[tuple[Frame, Matter, int]],
        places: FloatArray, entries: IntArray, held: int,
    ) -> None:  # fmt: skip
        """Derive and compile (collective).

        Args:
            joint: its declaration.
            ends: for each end its frame, its matter and the number of elastic coordinates of the
                node, 0 for the frame alone.
            places: (ends, 3) local coordinates of the nodes.
            entries: (k,) of each end's frame and node in the vector of all coordinates.
            held: the entry of fixed coordinates.

        Raises:
            ValueError: the function does not return numbers.
        """
        self.entries = entries
        self._cell = plain_cells(np.empty((1, 0)), entries[np.newaxis].astype(np.int32))
        free = entries[entries != held]
        self.distinct = len(np.unique(free)) == len(free)
        cell = basix.ufl.element("Lagrange", "interval", 1, shape=(1,))
        self._mesh = ufl.Mesh(cell)
        self._z, self._zd = (ufl.Coefficient(self._space(len(entries))) for _ in range(2))
        data = np.concatenate([places.ravel(), np.asarray(joint.data, dtype=np.float64), [0.0]])
        constant = ufl.Constant(self._mesh, shape=(len(data),))
        values = [ufl.as_ufl(e) for e in joint.function(*_states(ends, self._z, constant))]
        if not values or any(e.ufl_shape for e in values):
            raise ValueError(f"{joint.owner}: the function must return numbers, got {values!r}")
        self.count = len(values)
        self._multipliers = ufl.Constant(self._mesh, shape=(self.count,))
        self._numbers = {constant: data}
        self._kernels = {name: self._compile(form) for name, form in self._forms(values).items()}

    def _space(self, size: int) -> ufl.FunctionSpace:
        element = basix.ufl.element("DG", "interval", 0, shape=(size,))
        return ufl.FunctionSpace(self._mesh, element)

    def _forms(self, values: Sequence[Any]) -> dict[str, ufl.Form]:
        """Forms over a cell of unit length with one point: they are the numbers themselves."""
        dx = ufl.dx(metadata={"quadrature_degree": 0})
        z, zd = self._z, self._zd
        test = ufl.TestFunction(self._space(self.count))
        space = z.ufl_function_space()
        own, change = ufl.TestFunction(space), ufl.TrialFunction(space)
        weighted = sum(test[i] * e for i, e in enumerate(values)) * dx
        work = sum(self._multipliers[i] * e for i, e in enumerate(values)) * dx
        return {
            "values": weighted,
            "jacobian": _D(weighted, z, change),
            "bias": _D(_D(weighted, z, zd), z, zd),
            "stiffness": _D(_D(work, z, own), z, change),
        }

    def _compile(self, form: ufl.Form) -> tuple[CellKernel, FloatArray, FloatArray] | None:
        """A form's kernel, its constants and the multipliers among these; None if it vanishes."""
        if ufl.algorithms.expand_derivatives(form).empty():
            return None
        constants, at = np.zeros(1), 0
        numbers = self._numbers | {self._multipliers: np.zeros(self.count)}
        for c in form.constants():
            at = len(constants) - 1 if c is self._multipliers else at
            constants = np.concatenate([constants[:-1], numbers[c], [0.0]])
        kernel = coordinate_kernel(form, (self._z, self._zd))
        return kernel, constants, constants[at : at + self.count]

    def _evaluate(
        self, name: str, state: Coordinates, size: int, multipliers: FloatArray | None = None
    ) -> FloatArray:
        result, compiled = np.zeros(size), self._kernels[name]
        if compiled is not None:
            kernel, constants, room = compiled
            if multipliers is not None:
                room[:] = multipliers
            values = result.reshape(1, size)
            evaluate(kernel.memory, self._cell.memory, state.memory, constants, values)
        return result

    def values(self, state: Coordinates) -> FloatArray:
        """The numbers (count)."""
        return self._evaluate("values", state, self.count)

    def jacobian(self, state: Coordinates) -> FloatArray:
        """Their derivatives (count, k)."""
        k = len(self.entries)
        return self._evaluate("jacobian", state, self.count * k).reshape(self.count, k)

    def bias(self, state: Coordinates) -> FloatArray:
        """Their second time derivatives (count) without accelerations."""
        return self._evaluate("bias", state, self.count)

    def stiffness(self, state: Coordinates, multipliers: FloatArray) -> FloatArray:
        """Derivative (k, k) of the Jacobian's transpose times given multipliers."""
        k = len(self.entries)
        return self._evaluate("stiffness", state, k * k, multipliers).reshape(k, k)


def _states(
    ends: Sequence[tuple[Frame, Matter, int]], z: ufl.Coefficient, constant: ufl.Constant
) -> list[Any]:
    """Return the arguments with which a joint's function is called."""
    states: list[Any] = []
    at = 0
    for i, (frame, matter, nodal) in enumerate(ends):
        g = ufl.as_vector([z[at + j] for j in range(frame.count)])
        at += frame.count
        u = ufl.as_vector([z[at + j] for j in range(nodal)]) if nodal else None
        at += nodal
        x = ufl.as_vector([constant[3 * i + j] for j in range(3)])
        states.append(EndState(frame, g, matter, x, u))
    rest = range(3 * len(ends), constant.ufl_shape[0])
    return [*states, ufl.as_vector([constant[j] for j in rest])]
