# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of equilibria under increasing loads by their adjoints.

Every row of the history is an equilibrium ``F(q, L; t, p) = 0`` at a given load factor t, which
has no memory of those before. With the exact matrix A of Newton's method and a functional J of the
history each row takes one transposed solve, whatever the number of parameters:

``A^T z = dJ/d(q, L)``,  ``dJ/dp = J_p - z . F_p``

with J_p and F_p at the fixed state (Arora, Haug, AIAA J. 17 (1979) 970-974). q are local twists.
Parameters that change the shape at the start move nodes by dX: with these following, J_p gains
``J_q dX`` and z . F_p gains ``z . A dX``, which are the same.

Where the path ends at a value of a column c, its load factor depends on p: the last row has one
more unknown and one more equation. With ``D(J) = J_t - z_J . F_t``, the change of J with the load
factor along the path, ``dt/dp = - (c_p - z_c . F_p)/D(c)``, so that J has the adjoint
``z_J - D(J)/D(c) z_c`` there, and J_p loses ``D(J)/D(c) c_p``. Load factors of other rows count as
given.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.differences import extrapolated
from flexfem.gradients.equations.values import jump, row_directions, rows_turn
from flexfem.gradients.motion.columns import ColumnDerivatives, history_weights
from flexfem.gradients.motion.functionals import Functional
from flexfem.gradients.motion.trajectory import StoppedError
from flexfem.gradients.states.neighbours import NodeParameters, Parameter
from flexfem.gradients.states.node_places import Wanted, gradient_by_nodes
from flexfem.gradients.states.path import SINGULAR, Equilibria, NearPath
from flexfem.la.direct import DirectSolver
from flexfem.simulation.equilibria.targets import LOAD

__all__ = ["gradients_of_columns"]

#: Second differences of the equations over first ones, from which on they are no smooth functions
#: of a parameter.
_ROUGH = 0.1
#: Step of the load factor for what depends on it at a fixed state, relative to its end.
_TIME = 1e-4
#: Part of the step of the differences with which jumps are told from what is curved.
_NEAR = 1.0 / 32.0


def gradients_of_columns(
    path: Equilibria, functionals: Sequence[Functional],
    parameters: Sequence[Parameter | NodeParameters],
) -> FloatArray:  # fmt: skip
    """Derivatives (functionals, parameters) of functionals of the history (collective).

    Raises:
        InputError: a column has no derivatives, or the model has none by a parameter.
        StoppedError: an equilibrium is singular.
    """
    found = np.zeros((len(functionals), sum(one.count for one in parameters)))
    if not functionals:
        return found
    names = {name for one in functionals for name in one.columns if name != LOAD}
    chosen = sorted(names | {path.stop} if path.stop else names)
    columns = ColumnDerivatives(path, chosen)
    weights = history_weights(functionals, chosen, path.rows, path.history, path.system.comm)
    used = np.flatnonzero(weights.any(axis=(0, 1))).tolist()
    last = path.rows - 1
    if path.stop is not None:
        used = sorted({*used, last})
    loads = history_weights(functionals, [LOAD], path.rows, path.history, path.system.comm)
    _check_rows(path, {*used, *np.flatnonzero(loads.any(axis=(0, 1))).tolist()})
    if not used:  # of load factors that are given
        return found
    adjoints = {row: _adjoints(path, columns, weights[:, :, row], row) for row in used}
    places = [path.columns.index(name) for name in chosen]
    if path.stop is not None:
        own = _of_stop(path, columns, functionals, (weights[:, :, last], adjoints[last], places))
        weights[:, :, last], adjoints[last] = own
    numbers = _ByNumbers(path, adjoints, weights, places)
    at = 0
    for parameter in parameters:
        out = found[:, at : at + parameter.count]
        at += parameter.count
        if isinstance(parameter, NodeParameters):
            every = {row: columns.every(weights[:, :, row]) for row in used}
            share = gradient_by_nodes(path, Wanted(adjoints, every, chosen), parameter)
            out[:] = path.system.comm.allreduce(share)
        else:
            out[:, 0] = numbers.gradient(parameter)
    return found


class _ByNumbers:
    """Derivatives by numbers: differences between models at the rows of the path."""

    def __init__(
        self, path: Equilibria, adjoints: Mapping[int, FloatArray], weights: FloatArray,
        places: Sequence[int],
    ) -> None:  # fmt: skip
        """Measure what rounding leaves of the equations (collective).

        Args:
            path: the path.
            adjoints: (functionals, n) by the rows on which functionals depend.
            weights: (functionals, columns, rows).
            places: of the columns.
        """
        self._path, self._adjoints = path, adjoints
        self._weights, self._places = weights, places
        self._rounding = np.zeros(len(weights))
        for row, z in adjoints.items():
            path.go_to(row)
            squares = np.array([*(z**2).sum(axis=1), (path.residual() ** 2).sum()])
            path.system.comm.Allreduce(MPI.IN_PLACE, squares)
            self._rounding += np.sqrt(squares[:-1] * squares[-1])

    def gradient(self, parameter: Parameter) -> FloatArray:
        """Derivatives (functionals,) by a number (collective).

        Raises:
            InputError: the model does not exist beside it, or its equations jump there.
        """
        jumps = dict[float, bool]()

        def difference(step: float) -> FloatArray:
            """Of both models, the same on all ranks."""
            found = np.zeros(len(self._weights))
            before, after = (self._at(parameter, by, found) for by in (-step, step))
            equations, directions = zip(before, after, self._own(), strict=True)
            jumps[step] = (
                jump(path.system.comm, equations[:2], equations[2], _ROUGH)
                or rows_turn(path.system.comm, directions[:2], directions[2], _ROUGH)
            )  # fmt: skip
            path.system.comm.Allreduce(MPI.IN_PLACE, found)
            return found

        path = self._path
        found, _ = extrapolated(difference, parameter.size, self._rounding)
        if jumps[shortest := min(jumps)]:
            difference(_NEAR * shortest)  # what is curved is straight so near
        if jumps[min(jumps)]:
            raise InputError(
                f'gradient: the equations jump where "{parameter.text}" changes, and have no '
                "derivative"
            )
        return found

    def _own(self) -> tuple[FloatArray, FloatArray]:
        """The equations at the present state, and the directions of rows (collective)."""
        residual = self._path.residual()
        return residual, row_directions(self._path.system)

    def _at(
        self, parameter: Parameter, by: float, found: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Add the share of a model in a difference; the same of it at the last row (collective).

        Args:
            parameter: the number.
            by: its difference.
            found: (functionals,) on this rank.
        """
        path = self._path
        near = NearPath(path, parameter.beside(by), parameter.text)
        for row, z in self._adjoints.items():
            path.go_to(row)
            near.go_to_present()
            residual = path.vector(*near.residual())
            found -= z @ residual / (2.0 * by)
            values = near.columns()
            if len(values):  # on the first rank
                own = _direct(self._weights[:, :, row], values[self._places])
                found += own / (2.0 * by)
        return residual, row_directions(near.system)


def _check_rows(path: Equilibria, used: Set[int]) -> None:
    """Refuse rows whose load factors depend on parameters, but the last one."""
    if not path.fixed[[row for row in used if row != path.rows - 1]].all():
        raise InputError(
            "gradient: along arc lengths only the end of the path has derivatives; take final:…, "
            "or load steps"
        )


def _of_stop(
    path: Equilibria, columns: ColumnDerivatives, functionals: Sequence[Functional],
    of: tuple[FloatArray, FloatArray, Sequence[int]],
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Weights and adjoints of the last row at a value of a column, see the module (collective).

    Args:
        path: the path.
        columns: derivatives of the columns.
        functionals: those that are differentiated.
        of: weights (functionals, columns) and adjoints at its load factor, places of the columns.
    """
    weights, adjoints, places = of
    row, comm = path.rows - 1, path.system.comm
    stop = np.zeros((1, weights.shape[1]))
    stop[0, [path.columns[k] for k in places].index(str(path.stop))] = 1.0
    z = np.vstack([adjoints, _adjoints(path, columns, stop, row)])
    every = np.vstack([weights, stop])
    changes = -(z @ path.by_load())
    t, step = float(path.times[row]), _TIME * path.options.t_end
    before, after = path.columns_at(t - step), path.columns_at(t + step)
    if len(before):  # on the first rank
        changes += _direct(every, ((after - before) / (2.0 * step))[list(places)])
        for k, one in enumerate(functionals):
            moved = [
                dict(path.history, t=path.times + by * (path.times == t)) for by in (-step, step)
            ]
            low, high = (one.value(history) for history in moved)
            changes[k] += (high - low) / (2.0 * step)
    comm.Allreduce(MPI.IN_PLACE, changes)
    if changes[-1] == 0.0:
        raise StoppedError(f"gradient: {path.stop} does not change with the load factor at the end")
    ratio = (changes[:-1] / changes[-1])[:, np.newaxis]
    return weights - ratio * stop, adjoints - ratio * z[-1:]


def _adjoints(
    path: Equilibria, columns: ColumnDerivatives, weights: FloatArray, row: int
) -> FloatArray:
    """(functionals, n) this rank's part of z at a row of the history (collective)."""
    path.go_to(row)
    matrix = path.matrix()
    turned = matrix.transpose(PETSc.Mat())
    solver = DirectSolver(turned, "tangent_")
    path.system.counters.factorizations += 1
    if not solver.factor(turned):
        raise StoppedError(SINGULAR)
    x, b = turned.createVecs()
    found = np.zeros((len(weights), path.size))
    for own, weight in zip(found, weights, strict=True):
        right = _seed(path, columns, row, weight)
        left = right.copy()
        for _ in range(2):  # the second time for what rounding has left
            b.setArray(left)
            if not solver.solve(b, x):
                raise StoppedError(SINGULAR)
            own[:] += x.getArray(readonly=True)
            x.setArray(own)
            turned.mult(x, b)
            left = right - b.getArray(readonly=True)
    matrix.destroy()
    turned.destroy()
    return found


def _seed(
    path: Equilibria, columns: ColumnDerivatives, row: int, weights: FloatArray
) -> FloatArray:
    """This rank's part of the derivative of a functional by the state of a row (collective)."""
    blocks, found = [], columns.seeds(row, weights)
    for part, seeds in zip(path.system.parts, found.blocks, strict=True):
        blocks.append(np.zeros_like(part.block.owned_step))
        np.add.at(blocks[-1], seeds.nodes, seeds.twists[:, : part.block.width])
    return path.vector(blocks, found.forces / path.shifts.scale)


def _direct(weights: FloatArray, values: FloatArray) -> FloatArray:
    """Sums of columns with weights (functionals, columns) that are not zero."""
    found: FloatArray = np.where(weights == 0.0, 0.0, weights * values).sum(axis=1)
    return found
