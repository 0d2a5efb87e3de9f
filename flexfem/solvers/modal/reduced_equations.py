# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linearised equations in a few coordinates that satisfy the constraints."""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.laws import LawKind
from flexfem.la.dense import gather_rows
from flexfem.solvers.modal.linearization import Linearization, Matrices
from flexfem.solvers.modal.mode_errors import ComplexArray
from flexfem.solvers.modal.steady_rotation import constraint_solver

__all__ = ["Inputs", "Reduction", "reduce_equations"]

#: Share of the largest Gram eigenvalue below which real and imaginary parts are dependent.
_DEPENDENT = 1e-10


@dataclass(frozen=True)
class Inputs:
    """What acts on the linearised equations from outside, on this rank's range.

    Attributes:
        actuators: names of the actuators.
        drives: names of the rows of driven joints.
        forces: (l + k, n_local) of the loads at amplitude one, then of the actuators at one.
        targets: (m, rows) ones for the rows of the drives that this rank owns.
    """

    actuators: tuple[str, ...]
    drives: tuple[str, ...]
    forces: FloatArray
    targets: FloatArray

    @classmethod
    def of(cls, linearization: Linearization, loads: int) -> "Inputs":
        """Those at the state of the last evaluation (collective).

        Args:
            linearization: evaluated at the state.
            loads: number of loads of the model.
        """
        drives, targets = _drives(linearization, rigid=True)
        actuators, rows = _drives(linearization, rigid=False)
        forces = [_load_forces(linearization, loads), _actuator_forces(linearization, rows)]
        return cls(actuators, drives, np.concatenate(forces), targets)


@dataclass(frozen=True)
class Reduction:
    """``M q'' + C (q', s') + K (q, s, z) + N s'' = F a``, ``u = T q + S s``, equal on all ranks.

    The drives' coordinates s are the changes of the targets of the rows of driven joints, ``G u =
    s``; S is the least solution of this. The states z of force elements satisfy ``z' + V (q', s') +
    R (q, s, z) = 0``.

    Attributes:
        basis: (n + m, n_local) rows of T and S on this rank's nodes.
        mass: (n, n).
        damping: (n, n + m).
        stiffness: (n, n + m + k), the last columns those of k states.
        state_damping, state_stiffness: (k, n + m) and (k, n + m + k), V and R.
        driven_mass: (n, m), N.
        loads: (n, l), F: forces of the loads at amplitude one, then unit forces of the actuators.
        actuators: names of the actuators.
        names: names of the drives' coordinates.
    """

    basis: FloatArray
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    state_damping: FloatArray
    state_stiffness: FloatArray
    driven_mass: FloatArray
    loads: FloatArray
    actuators: tuple[str, ...]
    names: tuple[str, ...]

    @property
    def drives(self) -> int:
        """Number of the drives' coordinates."""
        return len(self.names)


def reduce_equations(
    linearization: Linearization, loads: int, shapes: ComplexArray | None
) -> Reduction:
    """Project the equations at the state of the last evaluation (collective).

    Args:
        linearization: evaluated at the state.
        loads: number of loads of the model.
        shapes: (k, n_local) modes whose real and imaginary parts span the motions; None for all
            motions that the constraints allow, of a model small enough for dense matrices.
    """
    matrices = linearization.matrices()
    inputs = Inputs.of(linearization, loads)
    free, driven = _bases(linearization, matrices, inputs.targets, shapes)
    basis, states = np.concatenate([free, driven]), _unit_states(linearization)
    units = np.ones(linearization.unknowns)
    units[linearization.states_range] = linearization.states.units
    every = np.concatenate([basis, states / units])
    products = [
        linearization.multiply(matrix, every, laws=laws).real
        for matrix, laws in (
            (matrices.mass, None),
            (matrices.damping, matrices.stiffness),
            (matrices.stiffness, matrices.stiffness),
        )
    ]
    comm, count = linearization.system.comm, len(free)
    tested = np.concatenate([free, states * units])
    M, C, K = (comm.allreduce(tested @ product.T, op=MPI.SUM) for product in products)
    M, C = M[:, : len(basis)], C[:, : len(basis)]
    forces = comm.allreduce(free @ inputs.forces.T, op=MPI.SUM)
    return Reduction(
        basis, M[:count, :count], C[:count], K[:count], C[count:], K[count:], M[:count, count:],
        forces, inputs.actuators, inputs.drives,
    )  # fmt: skip


def _unit_states(linearization: Linearization) -> FloatArray:
    """(k, n_local) one for each state of all ranks' force elements."""
    comm, count = linearization.system.comm, linearization.states.count
    first = comm.scan(count) - count
    out = np.zeros((comm.allreduce(count), linearization.unknowns))
    out[first : first + count, linearization.states_range] = np.eye(count)
    return out


def _drives(linearization: Linearization, rigid: bool) -> tuple[tuple[str, ...], FloatArray]:
    """Names of the driven rows, and for each the values (m, rows) it adds to this rank's rows.

    Rigid ones prescribe a motion, the others are actuators.
    """
    rows, comm = linearization.system.constraints, linearization.system.comm
    mine = []
    for placed, first, last in zip(rows.joints, rows.start[:-1], rows.start[1:], strict=True):
        holds = rows.elastic[first, 0] == LawKind.RIGID
        if placed.owned and placed.joint.driven and holds == rigid:
            # friction is none
            own_rows = np.flatnonzero(~rows.frictional[first:last])
            for k, row in enumerate(own_rows.tolist()):
                name = placed.joint.name if len(own_rows) == 1 else f"{placed.joint.name}_{k + 1}"
                mine.append((placed.index, k, name, int(rows.numbers[first + row])))
    every = sorted(row for part in comm.allgather(mine) for row in part)
    own = rows.numbers[rows.owned_rows]
    targets = np.array([[float(number == i) for i in own] for *_, number in every])
    return tuple(name for *_, name, _ in every), targets.reshape(len(every), len(own))


def _load_forces(linearization: Linearization, loads: int) -> FloatArray:
    """(l, n_local) forces of each load at amplitude one on this rank's nodes."""
    system = linearization.system
    kept = system.factors.copy()
    forces = np.zeros((loads, linearization.unknowns))
    for i in range(loads):
        system.factors[:] = 0.0
        system.factors[i] = 1.0
        pieces = []
        for part in system.parts:
            part.block.residual[:] = 0.0
            part.forces.add_residual(part.block, system.factors, -1.0)
            for inside in part.line_forces:
                inside.add_residual(part.block, system.factors, -1.0)
            part.block.add_ghosts()
            pieces.append(part.block.owned_residual.ravel().copy())
        forces[i, : linearization.states_range.start] = np.concatenate(pieces)
    system.factors[:] = kept
    return forces


def _actuator_forces(linearization: Linearization, targets: FloatArray) -> FloatArray:
    """(k, n_local) forces of each actuator at one on this rank's nodes.

    Args:
        linearization: evaluated at the state.
        targets: (k, rows) ones for the rows of each actuator that this rank owns.
    """
    system, rows = linearization.system, linearization.system.constraints
    owned = rows.numbers[rows.owned_rows]
    forces = np.zeros((len(targets), linearization.unknowns))
    for i, target in enumerate(targets):
        number = system.comm.allreduce(int(owned @ target), op=MPI.SUM)
        for part in system.parts:
            part.block.residual[:] = 0.0
        system.add_constraint_forces((rows.numbers == number).astype(np.float64))
        residuals = [part.block.owned_residual.ravel() for part in system.parts]
        forces[i, : linearization.states_range.start] = np.concatenate(residuals)
    return forces


def _bases(
    linearization: Linearization, matrices: Matrices, targets: FloatArray,
    shapes: ComplexArray | None,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Rows of T and S on this rank's nodes."""
    lin, comm = linearization, linearization.system.comm
    if shapes is not None:
        moving = shapes.copy()
        moving[:, lin.states_range] = 0.0
        return _spanned(lin, moving), _driven(lin, matrices, targets)
    kinds, nodal = lin.rigid_rows(), lin.states_range.start
    kinds[:nodal] = -1.0
    kinds = np.concatenate(comm.allgather(kinds))
    G = gather_rows(matrices.stiffness)[np.ix_(kinds > 0.0, kinds < 0.0)]
    first = comm.scan(nodal) - nodal
    motions = null_space(G).T[:, first : first + nodal]
    free = np.pad(motions, ((0, 0), (0, lin.states.count)))
    return free, _driven(lin, matrices, targets)


def _spanned(linearization: Linearization, shapes: ComplexArray) -> FloatArray:
    """Orthonormal basis of the real and imaginary parts of shapes."""
    parts = np.concatenate([shapes.real, shapes.imag])
    gram = linearization.system.comm.allreduce(parts @ parts.T, op=MPI.SUM)
    weights, turn = np.linalg.eigh(gram)
    kept = weights > _DEPENDENT * weights.max()
    basis: FloatArray = (turn[:, kept] / np.sqrt(weights[kept])).T @ parts
    return basis


def _driven(
    linearization: Linearization, matrices: Matrices, targets: FloatArray
) -> FloatArray:  # fmt: skip
    """S: the solutions of ``[[1, G^T], [G, 0]] (u, mu) = (0, s)``."""
    lin = linearization
    solve = constraint_solver(lin, matrices, None)
    rows = []
    for target in targets:
        solution = solve(np.concatenate([np.zeros(lin.unknowns), target]))
        assert solution is not None  # independent rows have been checked
        rows.append(solution.getArray()[: lin.unknowns].copy())
    return np.array(rows).reshape(len(rows), lin.unknowns)


def null_space(G: FloatArray) -> FloatArray:
    """Orthonormal basis (n, n - rank) of the null space of G (m, n)."""
    if len(G) == 0:
        return np.eye(G.shape[1])
    _, sizes, rows = np.linalg.svd(G)
    rank = int(np.sum(sizes > 1e-12 * sizes.max(initial=0.0)))
    basis: FloatArray = rows[rank:].T.copy()
    return basis
